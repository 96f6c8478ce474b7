/* SPDX-License-Identifier: Apache-2.0 */
/*
 * For hosts: makes the values of a procedural from its declared defaults and from values that the host sets
 * by name. C99 and C++20, header only. The same is valid and invalid as in a scene file: names, types,
 * ranges, choices, ramps, keys, lists.
 *
 *   MarramProcedural groom;
 *   if (marram_find_procedural(library, "groom", &host, &groom) != MARRAM_OK) return 1;
 *   MarramHostValues* values = marram_values_new(&groom);
 *   marram_set(values, "on", "ground");                        as in a scene file
 *   marram_set(values, "length", "[0.1, 0.3]");
 *   marram_set_number(values, "wind.speed", 7);
 *   marram_set(values, "wind.gusts.control[0].shape", "box");  an element of a list, with defaults otherwise
 *   const MarramValues* lent = marram_values_finish(values, &host);
 *   if (!lent) return 1;                                       host.message has been called for every mistake
 *   groom.create(&host, lent, &instance);
 *   marram_values_free(values);
 *
 * A wrong value is not stored: the previous value stays, and the error is reported by each
 * marram_values_finish() until the name is set correctly or reset. The same values may be changed and
 * finished again for update(). One thread at a time.
 *
 * Ids of its messages: host.library, host.procedural, host.name, host.value, host.missing, host.list,
 * host.memory.
 */
#ifndef MARRAM_HOST_H
#define MARRAM_HOST_H

#include "marram_plugin.h"

#if defined(__unix__) || defined(__APPLE__)
#include <dlfcn.h>
#endif
#include <locale.h>
#include <math.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* ---- Functions for hosts, defined below ---------------------------------------------------------------- */

typedef struct MarramHostValues MarramHostValues;

/* Copies a procedural of a library, as far as this version of the contract knows its fields. On failure
 * reports the reason through host->message: another ABI or Embree, no such name, an unknown parameter type, a
 * missing function. */
static inline MarramStatus marram_find_procedural(const MarramLibrary* library, const char* name,
                                                  const MarramHost* host, MarramProcedural* out);

#if defined(__unix__) || defined(__APPLE__)
/* The same, after loading a library, which stays loaded. A path without a folder is searched where dlopen() does. */
static inline MarramStatus marram_load_procedural(const char* path, const char* name, const MarramHost* host,
                                                  MarramProcedural* out);
#endif

/* Simple callbacks of a MarramHost: prints messages to stderr; never cancels. */
static inline void marram_print_message(void* user, const MarramMessage* message);
static inline int marram_never_cancelled(void* user);

/* A frame with the defaults of a marram scene, at the first of its motion samples: 24 frames a second, strands bound at
 * frame 1, the whole chain, a tolerance of 1 mm. `times` is not copied. Set device, colliders, meshes and pose. */
static inline MarramFrame marram_default_frame(const double* times, uint32_t time_count);

/* A mesh that does not move, with all roles, without normals and uvs. `positions` is not copied: it points to one
 * pointer to 3 * vertex_count floats. */
static inline MarramMesh marram_static_mesh(const char* name, uint32_t geometry_id,
                                            const float* const* positions, uint32_t vertex_count,
                                            const uint32_t* triangles, uint32_t triangle_count);

/* Lends meshes of which none moves: sets meshes, mesh_count, pose and pose_user of the frame. */
static inline void marram_lend_static(MarramFrame* frame, const MarramMesh* meshes, uint32_t mesh_count);

/* The index buffer of an Embree curve geometry: the number of cubic segments of all curves, and the first vertex of
 * each. MARRAM_CURVES only. */
static inline uint64_t marram_segment_count(const MarramOutput* output);
static inline void marram_segment_indices(const MarramOutput* output, uint32_t* indices);

/* Values with defaults only. The library must stay loaded. NULL: out of memory. */
static inline MarramHostValues* marram_values_new(const MarramProcedural* type);
static inline void marram_values_free(MarramHostValues* values);

/* The MarramValue.place of values set from now on, with which messages about them begin. Initially "". */
static inline void marram_values_place(MarramHostValues* values, const char* place);

/* The functions below return MARRAM_ERROR if the value is wrong. marram_values_finish() reports why. */

/* TOML as in a scene file: 7, 0.5, true, [0, 1, 0], [[0, 0.2], [1, 1]],
 * { knots = [...], interpolation = "smooth" }, { translate = [0, 1, 0] }, { keys = [...] }. Texts may leave
 * out their quotes. Blanks around a value are ignored. */
static inline MarramStatus marram_set(MarramHostValues* values, const char* name, const char* toml);
/* For MARRAM_BOOLEAN (0 or 1), MARRAM_INTEGER, MARRAM_NUMBER. Sets all components of ranges and colours. */
static inline MarramStatus marram_set_number(MarramHostValues* values, const char* name, double number);
/* For the same types, and for vectors, ranges and colours. */
static inline MarramStatus marram_set_numbers(MarramHostValues* values, const char* name,
                                              const double* numbers, size_t count);
/* For texts, choices, names of meshes and curves, types of elements. Without quotes. */
static inline MarramStatus marram_set_text(MarramHostValues* values, const char* name, const char* text);
/* Position and value of each knot; "linear", "smooth" or "constant". */
static inline MarramStatus marram_set_ramp(MarramHostValues* values, const char* name, const double* knots,
                                           size_t number_count, const char* interpolation);
/* Ten numbers per key, see MARRAM_KEYS; "linear" or "smooth". */
static inline MarramStatus marram_set_keys(MarramHostValues* values, const char* name, const double* numbers,
                                           size_t number_count, const char* interpolation);
/* An image (text: its path) or a table (text: its columns' names, separated by commas) that the host has
 * read. Not copied: it must live until create() or update() has returned. placement may be NULL. */
static inline MarramStatus marram_set_grid(MarramHostValues* values, const char* name, const MarramGrid* grid,
                                           const MarramPlacement* placement, const char* text);
/* The name of curves, and the attributes that they have, without values: strands made from these curves have them,
 * too. Not copied: see marram_set_grid(). */
static inline MarramStatus marram_set_curves(MarramHostValues* values, const char* name, const char* curves,
                                             const MarramAttribute* attributes, uint32_t attribute_count);
/* Restores the default. */
static inline void marram_reset(MarramHostValues* values, const char* name);
/* Adds an element with defaults to a list: "wind.gusts.control", "layer". type: for a list whose elements
 * have types (MarramItemType), else NULL. Returns the index, or -1 on failure. Setting a value of an element
 * adds the element, too. */
static inline long marram_add(MarramHostValues* values, const char* list, const char* type);

/* All values, for create() or update(). Valid until the next call with these values. NULL if anything is
 * wrong: all errors have then been reported to host, which may be NULL. */
static inline const MarramValues* marram_values_finish(MarramHostValues* values, const MarramHost* host);

/* ---- Implementation ------------------------------------------------------------------------------------ */

typedef struct MarramHostSetting {
    char* name;
    uint32_t hash; /* of the name */
    MarramParamType type;
    double* numbers;
    size_t number_count;
    char *text, *place;
    const MarramGrid* grid;
    const MarramPlacement* placement;
    const MarramAttribute* attributes;
    uint32_t attribute_count;
} MarramHostSetting;

typedef struct MarramHostElement {
    char* name; /* "layer[2]" */
    char* place;
    const MarramItemType*
        item; /* its type, in the library; NULL if the list has no types, or none is set yet */
} MarramHostElement;

typedef struct MarramHostComplaint {
    const char* id;
    char *name, *place, *what, *remedy;
} MarramHostComplaint;

struct MarramHostValues {
    MarramProcedural type;
    char* place;
    MarramHostSetting* settings; /* values set by the host */
    size_t setting_count, setting_room;
    MarramHostElement* elements;
    size_t element_count, element_room;
    MarramHostComplaint* complaints;
    size_t complaint_count, complaint_room;
    MarramHostSetting* defaults; /* this and all members below: results of the last finish */
    size_t default_count, default_room;
    MarramValue* list;
    MarramValues lent;
    int no_memory; /* since the last finish */
};

/* Parameters among which a name is searched. */
typedef struct MarramHostParams {
    const MarramParam* first;
    uint32_t count, stride;
} MarramHostParams;

/* A parsed value that has not been checked. */
typedef struct MarramHostParsed {
    double* numbers;
    size_t count, room;
    char* text;
    int fraction; /* a number has a point or an exponent */
    int no_memory;
} MarramHostParsed;

enum { marram_host_key_numbers = 10, marram_host_longest_name = 120, marram_host_longest_number = 64 };

/* ---- Memory ---- */

static inline char* marram_host_copy(const char* text, size_t size) {
    char* copy = (char*)malloc(size + 1);
    if (!copy) return NULL;
    memcpy(copy, text, size);
    copy[size] = '\0';
    return copy;
}

static inline char* marram_host_print_list(const char* format, va_list arguments) {
    va_list again;
    va_copy(again, arguments);
    const int size = vsnprintf(NULL, 0, format, again);
    va_end(again);
    char* text = size < 0 ? NULL : (char*)malloc((size_t)size + 1);
    if (text) vsnprintf(text, (size_t)size + 1, format, arguments);
    return text;
}

#if defined(__GNUC__)
__attribute__((format(printf, 1, 2)))
#endif
static inline char*
marram_host_print(const char* format, ...) {
    va_list arguments;
    va_start(arguments, format);
    char* text = marram_host_print_list(format, arguments);
    va_end(arguments);
    return text;
}

/* Grows an array of `count` elements for one more. 0: out of memory. */
static inline int marram_host_grow(void** first, size_t count, size_t* room, size_t size) {
    if (count < *room) return 1;
    const size_t more = *room ? 2 * *room : 16;
    void* grown = realloc(*first, more * size);
    if (!grown) return 0;
    *first = grown;
    *room = more;
    return 1;
}

static inline void marram_host_free_setting(MarramHostSetting* setting) {
    free(setting->name);
    free(setting->numbers);
    free(setting->text);
    free(setting->place);
}

static inline void marram_host_free_complaint(MarramHostComplaint* complaint) {
    free(complaint->name);
    free(complaint->place);
    free(complaint->what);
    free(complaint->remedy);
}

static inline void marram_host_free_parsed(MarramHostParsed* parsed) {
    free(parsed->numbers);
    free(parsed->text);
}

static inline void marram_host_add_number(MarramHostParsed* parsed, double number) {
    void* first = parsed->numbers;
    if (!marram_host_grow(&first, parsed->count, &parsed->room, sizeof(double))) {
        parsed->no_memory = 1;
        return;
    }
    parsed->numbers = (double*)first;
    parsed->numbers[parsed->count++] = number;
}

/* ---- Names ---- */

static inline uint32_t marram_host_hash(const char* text) { /* FNV-1a */
    uint32_t hash = 2166136261u;
    for (; *text; ++text) hash = (hash ^ (unsigned char)*text) * 16777619u;
    return hash;
}

static inline char marram_host_lower(char c) { return c >= 'A' && c <= 'Z' ? (char)(c - 'A' + 'a') : c; }

/* Number of edits from a to b: insert, delete, replace, swap of neighbours; case ignored. Both are at most
 * marram_host_longest_name long. */
static inline size_t marram_host_edits(const char* a, const char* b) {
    size_t before[marram_host_longest_name + 1], last[marram_host_longest_name + 1],
        row[marram_host_longest_name + 1];
    const size_t rows = strlen(a), columns = strlen(b);
    for (size_t j = 0; j <= columns; ++j) before[j] = last[j] = j;
    for (size_t i = 1; i <= rows; ++i) {
        row[0] = i;
        for (size_t j = 1; j <= columns; ++j) {
            const char x = marram_host_lower(a[i - 1]), y = marram_host_lower(b[j - 1]);
            size_t least = last[j - 1] + (x == y ? 0 : 1);
            if (last[j] + 1 < least) least = last[j] + 1;
            if (row[j - 1] + 1 < least) least = row[j - 1] + 1;
            if (i > 1 && j > 1 && x == marram_host_lower(b[j - 2]) && marram_host_lower(a[i - 2]) == y &&
                before[j - 2] + 1 < least)
                least = before[j - 2] + 1;
            row[j] = least;
        }
        memcpy(before, last, sizeof last);
        memcpy(last, row, (columns + 1) * sizeof *row);
    }
    return last[columns];
}

/* Searches the nearest of the names that are offered one by one, within the edits allowed for a typing
 * mistake. */
typedef struct MarramHostNearest {
    const char* name;
    size_t least;
    char best[marram_host_longest_name + 1];
} MarramHostNearest;

static inline void marram_host_seek(MarramHostNearest* nearest, const char* name) {
    const size_t size = strlen(name);
    nearest->name = name;
    nearest->least = size <= 3 ? 2 : size <= 7 ? 3 : 4;
    nearest->best[0] = '\0';
}

static inline void marram_host_offer(MarramHostNearest* nearest, const char* candidate) {
    const size_t size = strlen(nearest->name), other = strlen(candidate);
    if (size > marram_host_longest_name || other > marram_host_longest_name) return;
    const size_t edits = marram_host_edits(nearest->name, candidate);
    if (edits >= nearest->least || edits >= (size > other ? size : other)) return;
    nearest->least = edits;
    memcpy(nearest->best, candidate, other + 1);
}

/* Offers each part of "a|b|c". Returns 1 if one of them is the name. */
static inline int marram_host_offer_choices(MarramHostNearest* nearest, const char* choices) {
    int found = 0;
    while (*choices) {
        const size_t size = strcspn(choices, "|");
        char one[marram_host_longest_name + 1];
        if (size <= marram_host_longest_name) {
            memcpy(one, choices, size);
            one[size] = '\0';
            found = found || strcmp(one, nearest->name) == 0;
            marram_host_offer(nearest, one);
        }
        choices += size + (choices[size] == '|' ? 1 : 0);
    }
    return found;
}

/* The text after the `[12]` that it begins with; NULL if it begins with none. Leading zeros are invalid, so
 * that an element has only one name. */
static inline const char* marram_host_after_index(const char* text) {
    size_t digits = 0;
    if (text[0] != '[') return NULL;
    while (text[1 + digits] >= '0' && text[1 + digits] <= '9') ++digits;
    if (digits < 1 || digits > 9 || (digits > 1 && text[1] == '0') || text[1 + digits] != ']') return NULL;
    return text + digits + 2;
}

/* "gusts.control[12].shape" -> "gusts.control[].shape". NULL: out of memory. */
static inline char* marram_host_declared_name(const char* name) {
    char* declared = marram_host_copy(name, strlen(name));
    char* out = declared;
    if (!declared) return NULL;
    while (*name) {
        const char* after = marram_host_after_index(name);
        if (after && *after == '.') {
            *out++ = '[';
            *out++ = ']';
            name = after;
        } else {
            *out++ = *name++;
        }
    }
    *out = '\0';
    return declared;
}

/* ---- Complaints ---- */

/* Makes text of unknown origin printable on one line, and shortens it. NULL: out of memory. */
static inline char* marram_host_clean(const char* text) {
    const size_t longest = 60, size = strlen(text);
    char* clean =
        size > longest ? marram_host_print("%.*s...", (int)longest, text) : marram_host_copy(text, size);
    if (clean)
        for (char* c = clean; *c; ++c)
            if ((unsigned char)*c < 32 || *c == 127) *c = '?';
    return clean;
}

/* Adds a complaint. Takes ownership of what and remedy. */
static inline MarramStatus marram_host_complain(MarramHostValues* values, const char* id, const char* name,
                                                const char* place, char* what, char* remedy) {
    MarramHostComplaint complaint;
    complaint.id = id;
    complaint.name = marram_host_copy(name, strlen(name));
    complaint.place = marram_host_copy(place, strlen(place));
    complaint.what = what;
    complaint.remedy = remedy;
    void* first = values->complaints;
    if (!complaint.name || !complaint.place || !what || !remedy ||
        !marram_host_grow(&first, values->complaint_count, &values->complaint_room, sizeof complaint)) {
        marram_host_free_complaint(&complaint);
        values->no_memory = 1;
        return MARRAM_ERROR;
    }
    values->complaints = (MarramHostComplaint*)first;
    values->complaints[values->complaint_count++] = complaint;
    return MARRAM_ERROR;
}

/* Removes the complaints about a name, or all if name is NULL, from index `from` on. */
static inline void marram_host_forget(MarramHostValues* values, const char* name, size_t from) {
    size_t kept = from;
    for (size_t i = from; i < values->complaint_count; ++i) {
        MarramHostComplaint* complaint = &values->complaints[i];
        if (!name || strcmp(complaint->name, name) == 0)
            marram_host_free_complaint(complaint);
        else
            values->complaints[kept++] = *complaint;
    }
    values->complaint_count = kept;
}

/* Complains "name is <given>: give <wanted>", with the given text made printable. */
static inline MarramStatus marram_host_refuse(MarramHostValues* values, const char* name, const char* place,
                                              const char* given, char* remedy) {
    char *shown = marram_host_clean(given), *label = marram_host_clean(name);
    char* what = shown && label ? marram_host_print("%s is %s", label, shown) : NULL;
    free(shown);
    free(label);
    return marram_host_complain(values, "host.value", name, place, what, remedy);
}

static inline void marram_host_say(const MarramHost* host, const char* id, const char* place,
                                   const char* what, const char* remedy) {
    MarramMessage message;
    if (!host || !host->message) return;
    memset(&message, 0, sizeof message);
    message.size = sizeof message;
    message.severity = MARRAM_FAULT;
    message.id = id;
    message.place = place;
    message.what = what;
    message.remedy = remedy;
    host->message(host->user, &message);
}

/* The remedy for a wrong value of a parameter: "give [low, high], from 0 to 10 m". NULL: out of memory. */
static inline char* marram_host_wanted(const MarramParam* param) {
    const MarramTypeForm* form = marram_type_form(param->type);
    const char* unit = *param->unit ? " " : "";
    if (!form) return marram_host_print("leave it out");
    if (form->components > 0)
        return marram_host_print("read the file, and hand it over by marram_set_grid()");
    if (form->text == MARRAM_CHOICE_TEXT) return marram_host_print("give one of %s", param->choices);
    if (form->range_bits == 0) return marram_host_print("give %s", form->written);
    return marram_host_print("give %s from %g to %g%s%s", form->written, param->minimum, param->maximum, unit,
                             param->unit);
}

/* ---- A strict parser of the TOML subset used by declarations ---- */

static inline void marram_host_skip(const char** at) {
    while (**at == ' ' || **at == '\t' || **at == '\n' || **at == '\r') ++*at;
}

static inline int marram_host_take(const char** at, char what) {
    marram_host_skip(at);
    if (**at != what) return 0;
    ++*at;
    return 1;
}

/* Copies digits, which may have single underscores between them, without the underscores. 0: none or too
 * many. */
static inline int marram_host_digits(const char** at, char* out, size_t* size) {
    const size_t before = *size;
    while ((**at >= '0' && **at <= '9') ||
           (**at == '_' && *size > before && (*at)[1] >= '0' && (*at)[1] <= '9')) {
        if (**at == '_') ++*at;
        if (*size + 8 > marram_host_longest_number) return 0;
        out[(*size)++] = *(*at)++;
    }
    return *size > before;
}

static inline int marram_host_number(const char** at, MarramHostParsed* parsed) {
    char text[marram_host_longest_number];
    const char* point = localeconv()->decimal_point; /* for strtod(): the host may have set a locale */
    size_t size = 0;
    marram_host_skip(at);
    if (**at == '+' || **at == '-') text[size++] = *(*at)++;
    if (**at == '0' && (((*at)[1] >= '0' && (*at)[1] <= '9') || (*at)[1] == '_')) return 0;
    if (!marram_host_digits(at, text, &size)) return 0;
    if (**at == '.') {
        ++*at;
        parsed->fraction = 1;
        for (; *point; ++point)
            if (size + 8 > marram_host_longest_number)
                return 0;
            else
                text[size++] = *point;
        if (!marram_host_digits(at, text, &size)) return 0;
    }
    if (**at == 'e' || **at == 'E') {
        ++*at;
        parsed->fraction = 1;
        text[size++] = 'e';
        if (**at == '+' || **at == '-') text[size++] = *(*at)++;
        if (!marram_host_digits(at, text, &size)) return 0;
    }
    text[size] = '\0';
    marram_host_add_number(parsed, strtod(text, NULL));
    return 1;
}

/* [1, 2, 3]: `count` numbers, or any number of them if count is 0. */
static inline int marram_host_numbers(const char** at, size_t count, MarramHostParsed* parsed) {
    size_t found = 0;
    if (!marram_host_take(at, '[')) return 0;
    while (!marram_host_take(at, ']')) {
        if (found > 0 && !marram_host_take(at, ',')) return 0;
        if (found > 0 && marram_host_take(at, ']')) break; /* a comma behind the last is allowed */
        if (!marram_host_number(at, parsed)) return 0;
        ++found;
    }
    return count == 0 || found == count;
}

/* `count` numbers, or one number that stands for all of them. */
static inline int marram_host_scalar_or_numbers(const char** at, size_t count, MarramHostParsed* parsed) {
    marram_host_skip(at);
    if (**at == '[') return marram_host_numbers(at, count, parsed);
    if (!marram_host_number(at, parsed)) return 0;
    for (size_t i = 1; i < count && !parsed->no_memory; ++i)
        marram_host_add_number(parsed, parsed->numbers[parsed->count - 1]);
    return 1;
}

/* A string in quotes of either kind. The caller frees *out. */
static inline int marram_host_string(const char** at, char** out, MarramHostParsed* parsed) {
    static const char names[] = "\"\\btnfr", meanings[] = "\"\\\b\t\n\f\r";
    marram_host_skip(at);
    const char quote = **at;
    if (quote != '"' && quote != '\'') return 0;
    char* text = (char*)malloc(strlen(*at) + 1);
    size_t size = 0;
    if (!text) {
        parsed->no_memory = 1;
        return 0;
    }
    for (++*at; **at != quote; ++*at) {
        char c = **at;
        const char* found = NULL;
        if (c == '\\' && quote == '"') {
            ++*at;
            found = **at ? strchr(names, **at) : NULL;
            c = found ? meanings[found - names] : '\0';
        } else if ((unsigned char)c < 32 && c != '\t') {
            c = '\0';
        }
        if (c == '\0') {
            free(text);
            return 0;
        }
        text[size++] = c;
    }
    ++*at;
    text[size] = '\0';
    *out = text;
    return 1;
}

/* Reads `key =` of an inline table. 0: another key. */
static inline int marram_host_key(const char** at, const char* key) {
    const size_t size = strlen(key);
    const char* ahead = *at;
    marram_host_skip(&ahead);
    if (strncmp(ahead, key, size) != 0) return 0;
    ahead += size;
    if (!marram_host_take(&ahead, '=')) return 0;
    *at = ahead;
    return 1;
}

static inline int marram_host_knots(const char** at, MarramHostParsed* parsed) {
    size_t found = 0;
    if (!marram_host_take(at, '[')) return 0;
    while (!marram_host_take(at, ']')) {
        if (found > 0 && !marram_host_take(at, ',')) return 0;
        if (found > 0 && marram_host_take(at, ']')) break;
        if (!marram_host_numbers(at, 2, parsed)) return 0;
        ++found;
    }
    return found > 0;
}

/* Reads the entries of an inline table up to its brace, each at most once. `entry` reads one and returns its
 * bit, 0 on failure. */
static inline int marram_host_table(const char** at, MarramHostParsed* parsed,
                                    unsigned (*entry)(const char** at, MarramHostParsed* parsed, void* user),
                                    void* user, unsigned* found) {
    *found = 0;
    if (!marram_host_take(at, '{')) return 0;
    while (!marram_host_take(at, '}')) {
        if (*found && !marram_host_take(at, ',')) return 0;
        const unsigned one = entry(at, parsed, user);
        if (!one || (*found & one)) return 0;
        *found |= one;
    }
    return 1;
}

static inline unsigned marram_host_ramp_entry(const char** at, MarramHostParsed* parsed, void* user) {
    (void)user;
    if (marram_host_key(at, "knots")) return marram_host_knots(at, parsed) ? 1 : 0;
    if (marram_host_key(at, "interpolation") && !parsed->text)
        return marram_host_string(at, &parsed->text, parsed) ? 2 : 0;
    return 0;
}

static inline int marram_host_ramp(const char** at, MarramHostParsed* parsed) {
    unsigned found = 0;
    marram_host_skip(at);
    if (**at == '{')
        return marram_host_table(at, parsed, marram_host_ramp_entry, NULL, &found) && (found & 1);
    return marram_host_knots(at, parsed);
}

/* frame (only if allowed), translate, rotate, scale of one key. user: its 10 numbers. */
static inline unsigned marram_host_key_entry(const char** at, MarramHostParsed* parsed, void* user) {
    static const char* const names[] = {"frame", "translate", "rotate", "scale"};
    double* key = (double*)user;
    for (unsigned i = 0; i < 4; ++i) {
        if (!marram_host_key(at, names[i])) continue;
        const size_t before = parsed->count, size = i == 0 ? 1 : 3;
        const int good = i == 0   ? marram_host_number(at, parsed)
                         : i == 3 ? marram_host_scalar_or_numbers(at, 3, parsed)
                                  : marram_host_numbers(at, 3, parsed);
        if (!good || parsed->count != before + size) return 0;
        memcpy(i == 0 ? key : key + 3 * i - 2, parsed->numbers + before, size * sizeof(double));
        parsed->count = before;
        return 1u << i;
    }
    return 0;
}

static inline void marram_host_add_key(MarramHostParsed* parsed, const double* key) {
    for (int i = 0; i < marram_host_key_numbers; ++i) marram_host_add_number(parsed, key[i]);
}

static inline unsigned marram_host_keys_entry(const char** at, MarramHostParsed* parsed, void* user) {
    size_t count = 0;
    (void)user;
    if (marram_host_key(at, "interpolation") && !parsed->text)
        return marram_host_string(at, &parsed->text, parsed) ? 2 : 0;
    if (!marram_host_key(at, "keys") || !marram_host_take(at, '[')) return 0;
    while (!marram_host_take(at, ']')) {
        double key[marram_host_key_numbers] = {0, 0, 0, 0, 0, 0, 0, 1, 1, 1};
        unsigned found = 0;
        if (count > 0 && !marram_host_take(at, ',')) return 0;
        if (count > 0 && marram_host_take(at, ']')) break;
        if (!marram_host_table(at, parsed, marram_host_key_entry, key, &found) || !(found & 1)) return 0;
        marram_host_add_key(parsed, key);
        ++count;
    }
    return count > 0 ? 1 : 0;
}

static inline int marram_host_keys(const char** at, MarramHostParsed* parsed) {
    double key[marram_host_key_numbers] = {0, 0, 0, 0, 0, 0, 0, 1, 1, 1};
    unsigned found = 0;
    const char* ahead = *at;
    if (!marram_host_take(&ahead, '{')) return 0;
    if (marram_host_key(&ahead, "keys") || marram_host_key(&ahead, "interpolation"))
        return marram_host_table(at, parsed, marram_host_keys_entry, NULL, &found) && (found & 1);
    if (!marram_host_table(at, parsed, marram_host_key_entry, key, &found) || (found & 1)) return 0;
    marram_host_add_key(parsed, key);
    return 1;
}

static inline int marram_host_is_text(const MarramTypeForm* form) {
    return form->text != MARRAM_NO_TEXT && form->numbers == 0 && form->components == 0;
}

static inline int marram_host_read_text(const char** at, MarramHostParsed* parsed) {
    marram_host_skip(at);
    if (**at == '"' || **at == '\'') return marram_host_string(at, &parsed->text, parsed);
    const size_t rest = strlen(*at);
    size_t size = rest; /* without trailing blanks */
    while (size > 0 && strchr(" \t\r\n", (*at)[size - 1])) --size;
    parsed->text = marram_host_copy(*at, size);
    parsed->no_memory = !parsed->text;
    *at += rest;
    return parsed->text != NULL;
}

static inline int marram_host_read(MarramParamType type, const char* toml, MarramHostParsed* parsed) {
    const MarramTypeForm* form = marram_type_form(type);
    const char* at = toml;
    int good = 0;
    if (!form) return 0;
    if (marram_host_is_text(form)) {
        good = marram_host_read_text(&at, parsed);
    } else if (type == MARRAM_RAMP) {
        good = marram_host_ramp(&at, parsed);
    } else if (type == MARRAM_KEYS) {
        good = marram_host_keys(&at, parsed);
    } else if (form->flags & MARRAM_ZERO_OR_ONE) {
        marram_host_skip(&at);
        good = strncmp(at, "true", 4) == 0 || strncmp(at, "false", 5) == 0;
        if (good) marram_host_add_number(parsed, *at == 't' ? 1.0 : 0.0);
        if (good) at += *at == 't' ? 4 : 5;
    } else if (form->numbers == 1) {
        good = marram_host_number(&at, parsed) && !((form->flags & MARRAM_WHOLE) && parsed->fraction);
    } else if (form->numbers > 1) {
        good = form->flags & MARRAM_OR_SCALAR ? marram_host_scalar_or_numbers(&at, (int)form->numbers, parsed)
                                              : marram_host_numbers(&at, (int)form->numbers, parsed);
    }
    marram_host_skip(&at);
    if (form->text == MARRAM_KEYWORD_TEXT && good && !parsed->text) {
        parsed->text = marram_host_copy(form->keywords, strcspn(form->keywords, "|"));
        parsed->no_memory = parsed->no_memory || !parsed->text;
    }
    return good && *at == '\0' && !parsed->no_memory;
}

/* ---- Checks of values, parsed or given as numbers ---- */

static inline MarramValueFault marram_host_fault(const MarramParam* param, const MarramHostParsed* parsed) {
    const MarramTypeForm* form = marram_type_form(param->type);
    size_t index = 0;
    return marram_value_fault(form, param->minimum, param->maximum, param->choices, parsed->numbers,
                              parsed->count, parsed->text, &index);
}

/* The remedy for a wrong value. */
static inline char* marram_host_remedy(const MarramParam* param, const MarramHostParsed* parsed) {
    MarramHostNearest nearest;
    const MarramTypeForm* form = marram_type_form(param->type);
    if (form->text == MARRAM_CHOICE_TEXT && parsed->text) {
        marram_host_seek(&nearest, parsed->text);
        marram_host_offer_choices(&nearest, param->choices);
        if (nearest.best[0]) return marram_host_print("did you mean \"%s\"?", nearest.best);
    }
    if ((form->flags & MARRAM_ASCENDING) && marram_host_fault(param, parsed) == MARRAM_WRONG_ORDER)
        return marram_host_print("give the lower number first");
    return marram_host_wanted(param);
}

/* ---- Elements of lists ---- */

static inline MarramHostElement* marram_host_find_element(const MarramHostValues* values, const char* name,
                                                          size_t size) {
    for (size_t i = 0; i < values->element_count; ++i)
        if (strncmp(values->elements[i].name, name, size) == 0 && values->elements[i].name[size] == '\0')
            return &values->elements[i];
    return NULL;
}

static inline MarramHostElement* marram_host_make_element(MarramHostValues* values, const char* name,
                                                          size_t size) {
    MarramHostElement* found = marram_host_find_element(values, name, size);
    void* first = values->elements;
    if (found) return found;
    char *copy = marram_host_copy(name, size),
         *place = marram_host_copy(values->place, strlen(values->place));
    if (!copy || !place ||
        !marram_host_grow(&first, values->element_count, &values->element_room, sizeof *values->elements)) {
        free(copy);
        free(place);
        values->no_memory = 1;
        return NULL;
    }
    values->elements = (MarramHostElement*)first;
    found = &values->elements[values->element_count++];
    found->name = copy;
    found->place = place;
    found->item = NULL;
    return found;
}

/* Makes all elements that a name is in: "layer[0]" and "layer[0].edit[1]" of "layer[0].edit[1].id". */
static inline void marram_host_make_elements(MarramHostValues* values, const char* name) {
    for (const char* at = name; *at; ++at) {
        const char* after = marram_host_after_index(at);
        if (after && *after == '.') marram_host_make_element(values, name, (size_t)(after - name));
    }
}

static inline const MarramItemType* marram_host_item_type(const MarramHostValues* values, uint32_t i) {
    return MARRAM_AT(MarramItemType, values->type.item_types, values->type.item_type_stride, i);
}

/* The element type of this name of a list; any of its types if `type` is NULL. `list` has length `size`. */
static inline const MarramItemType* marram_host_find_item(const MarramHostValues* values, const char* list,
                                                          size_t size, const char* type) {
    for (uint32_t i = 0; i < values->type.item_type_count; ++i) {
        const MarramItemType* item = marram_host_item_type(values, i);
        if (strncmp(item->list, list, size) == 0 && item->list[size] == '\0' &&
            (!type || strcmp(item->type, type) == 0))
            return item;
    }
    return NULL;
}

/* The known types of a list: "dune, noise". NULL: out of memory. */
static inline char* marram_host_listed_types(const MarramHostValues* values, const char* list, size_t size) {
    char* all = marram_host_copy("", 0);
    for (uint32_t i = 0; all && i < values->type.item_type_count; ++i) {
        const MarramItemType* item = marram_host_item_type(values, i);
        if (strncmp(item->list, list, size) != 0 || item->list[size] != '\0') continue;
        char* longer = marram_host_print("%s%s%s", all, *all ? ", " : "", item->type);
        free(all);
        all = longer;
    }
    return all;
}

/* ---- Where a name is declared ---- */

static inline const MarramParam* marram_host_find_param(MarramHostParams params, const char* name) {
    for (uint32_t i = 0; i < params.count; ++i) {
        const MarramParam* param = MARRAM_AT(MarramParam, params.first, params.stride, i);
        if (strcmp(param->name, name) == 0) return param;
    }
    return NULL;
}

static inline MarramHostParams marram_host_params_of_type(const MarramHostValues* values) {
    MarramHostParams params;
    params.first = values->type.params;
    params.count = values->type.param_count;
    params.stride = values->type.param_stride;
    return params;
}

static inline MarramHostParams marram_host_params_of_item(const MarramItemType* item) {
    MarramHostParams params;
    params.first = item->params;
    params.count = item->param_count;
    params.stride = item->param_stride;
    return params;
}

/* The part of a name that the type of its element declares: "edit[1].id" of "layer[0].edit[1].id", if layer
 * is a list whose elements have types; else NULL. list_size: length of "layer". */
static inline const char* marram_host_typed_part(const MarramHostValues* values, const char* name,
                                                 size_t* list_size) {
    const char* open = strchr(name, '[');
    const char* after = open ? marram_host_after_index(open) : NULL;
    if (!after || *after != '.') return NULL;
    *list_size = (size_t)(open - name);
    return marram_host_find_item(values, name, *list_size, NULL) ? after + 1 : NULL;
}

static inline MarramStatus marram_host_unknown(MarramHostValues* values, const char* name,
                                               MarramHostParams params, const char* declared) {
    MarramHostNearest nearest;
    const char* inner = NULL; /* "noise.frequency" if "frequency" was given */
    marram_host_seek(&nearest, declared);
    for (uint32_t i = 0; i < params.count; ++i) {
        const MarramParam* param = MARRAM_AT(MarramParam, params.first, params.stride, i);
        const char* dot = strrchr(param->name, '.');
        marram_host_offer(&nearest, param->name);
        if (!inner && dot && strcmp(dot + 1, declared) == 0) inner = param->name;
    }
    char* shown = marram_host_clean(name);
    char* what = shown ? marram_host_print("%s is unknown", shown) : NULL;
    free(shown);
    char* remedy = nearest.best[0] ? marram_host_print("did you mean \"%s\"?", nearest.best)
                   : inner         ? marram_host_print("did you mean \"%s\"?", inner)
                           : marram_host_print("see `marram info %s` for what there is", values->type.name);
    return marram_host_complain(values, "host.name", name, values->place, what, remedy);
}

/* The declaration of a name; NULL after a complaint. */
static inline const MarramParam* marram_host_declared(MarramHostValues* values, const char* name) {
    marram_host_forget(values, name, 0); /* earlier complaints about it */
    size_t size = 0;
    const char* rest = marram_host_typed_part(values, name, &size);
    MarramHostParams params = marram_host_params_of_type(values);
    if (rest) {
        const MarramHostElement* element = marram_host_find_element(values, name, (size_t)(rest - 1 - name));
        if (!element || !element->item) {
            char *types = marram_host_listed_types(values, name, size), *shown = marram_host_clean(name);
            char* what = shown ? marram_host_print("%s is set before the type of its element", shown) : NULL;
            char* remedy = types ? marram_host_print("set %.*s.type first, one of %s", (int)(rest - 1 - name),
                                                     name, types)
                                 : NULL;
            free(types);
            free(shown);
            marram_host_complain(values, "host.list", name, values->place, what, remedy);
            return NULL;
        }
        params = marram_host_params_of_item(element->item);
    }
    char* declared = marram_host_declared_name(rest ? rest : name);
    if (!declared) {
        values->no_memory = 1;
        return NULL;
    }
    const MarramParam* param = marram_host_find_param(params, declared);
    if (!param) marram_host_unknown(values, name, params, declared);
    free(declared);
    if (param && (param->type == MARRAM_UNAVAILABLE || !marram_type_form(param->type))) {
        marram_host_complain(values, "host.name", name, values->place,
                             marram_host_print("%s is not available in this library", param->name),
                             marram_host_print("leave it out (%s)", param->help));
        return NULL;
    }
    return param;
}

/* ---- Storing values ---- */

static inline MarramHostSetting* marram_host_find_setting(const MarramHostValues* values, const char* name) {
    const uint32_t hash = marram_host_hash(name);
    for (size_t i = 0; i < values->setting_count; ++i)
        if (values->settings[i].hash == hash && strcmp(values->settings[i].name, name) == 0)
            return &values->settings[i];
    return NULL;
}

/* Moves a parsed value into a setting; if `setting` is NULL, into a new one at the end of the array. 0: out
 * of memory. */
static inline int marram_host_store(MarramHostSetting* setting, MarramHostSetting** first, size_t* count,
                                    size_t* room, const char* name, MarramParamType type, const char* place,
                                    MarramHostParsed* parsed) {
    char *copy = marram_host_copy(name, strlen(name)), *where = marram_host_copy(place, strlen(place));
    char* text = parsed->text ? parsed->text : marram_host_copy("", 0);
    void* grown = *first;
    if (copy && where && text && !setting && marram_host_grow(&grown, *count, room, sizeof **first)) {
        *first = (MarramHostSetting*)grown;
        setting = *first + (*count)++;
        memset(setting, 0, sizeof *setting);
    }
    if (!copy || !where || !text || !setting) {
        free(copy);
        free(where);
        if (text != parsed->text) free(text);
        return 0;
    }
    marram_host_free_setting(setting);
    memset(setting, 0, sizeof *setting);
    setting->name = copy;
    setting->hash = marram_host_hash(name);
    setting->type = type;
    setting->numbers = parsed->numbers;
    setting->number_count = parsed->count;
    setting->text = text;
    setting->place = where;
    parsed->numbers = NULL;
    parsed->text = NULL;
    return 1;
}

/* Stores a checked value, and takes ownership of its memory. */
static inline MarramStatus marram_host_accept(MarramHostValues* values, const char* name,
                                              MarramParamType type, MarramHostParsed* parsed) {
    marram_host_make_elements(values, name);
    if (!marram_host_store(marram_host_find_setting(values, name), &values->settings, &values->setting_count,
                           &values->setting_room, name, type, values->place, parsed)) {
        values->no_memory = 1;
        return MARRAM_ERROR;
    }
    return MARRAM_OK;
}

/* given: text for the complaint. Frees the parsed value. */
static inline MarramStatus marram_host_check_and_accept(MarramHostValues* values, const char* name,
                                                        const MarramParam* param, MarramHostParsed* parsed,
                                                        int readable, const char* given) {
    MarramStatus status = MARRAM_ERROR;
    if (parsed->no_memory)
        values->no_memory = 1;
    else if (readable && marram_host_fault(param, parsed) == MARRAM_GOOD)
        status = marram_host_accept(values, name, param->type, parsed);
    else
        marram_host_refuse(values, name, values->place, given, marram_host_remedy(param, parsed));
    marram_host_free_parsed(parsed);
    return status;
}

/* Sets "layer[0].type". If the type changes, the values set for the old type are dropped. */
static inline MarramStatus marram_host_set_type(MarramHostValues* values, const char* name, size_t list_size,
                                                size_t element_size, const char* type) {
    const MarramItemType* item = marram_host_find_item(values, name, list_size, type);
    MarramHostNearest nearest;
    marram_host_forget(values, name, 0);
    if (!item) {
        marram_host_seek(&nearest, type);
        for (uint32_t i = 0; i < values->type.item_type_count; ++i) {
            const MarramItemType* one = marram_host_item_type(values, i);
            if (strncmp(one->list, name, list_size) == 0 && one->list[list_size] == '\0')
                marram_host_offer(&nearest, one->type);
        }
        char* types = marram_host_listed_types(values, name, list_size);
        char* remedy = nearest.best[0] ? marram_host_print("did you mean \"%s\"?", nearest.best)
                       : types         ? marram_host_print("give one of %s", types)
                                       : NULL;
        free(types);
        return marram_host_refuse(values, name, values->place, *type ? type : "empty", remedy);
    }
    MarramHostElement* element = marram_host_make_element(values, name, element_size);
    if (!element) return MARRAM_ERROR;
    if (element->item != item) {
        size_t kept = 0;
        for (size_t i = 0; i < values->setting_count; ++i)
            if (strncmp(values->settings[i].name, name, element_size) == 0 &&
                values->settings[i].name[element_size] == '.')
                marram_host_free_setting(&values->settings[i]);
            else
                values->settings[kept++] = values->settings[i];
        values->setting_count = kept;
        kept = 0;
        for (size_t i = 0; i < values->element_count; ++i)
            if (strncmp(values->elements[i].name, name, element_size) == 0 &&
                values->elements[i].name[element_size] == '.') {
                free(values->elements[i].name);
                free(values->elements[i].place);
            } else {
                values->elements[kept++] = values->elements[i];
            }
        values->element_count = kept;
        element = marram_host_find_element(values, name, element_size);
        element->item = item;
    }
    MarramHostParsed parsed;
    memset(&parsed, 0, sizeof parsed);
    parsed.text = marram_host_copy(item->type, strlen(item->type));
    parsed.no_memory = !parsed.text;
    const MarramStatus status =
        parsed.no_memory ? MARRAM_ERROR : marram_host_accept(values, name, MARRAM_CHOICE, &parsed);
    if (status != MARRAM_OK) values->no_memory = 1;
    marram_host_free_parsed(&parsed);
    return status;
}

/* If the name is that of an element's type, sets it and returns 1. */
static inline int marram_host_sets_type(MarramHostValues* values, const char* name, const char* type,
                                        MarramStatus* status) {
    size_t size = 0;
    const char* rest = marram_host_typed_part(values, name, &size);
    if (!rest || strcmp(rest, "type") != 0) return 0;
    *status = marram_host_set_type(values, name, size, (size_t)(rest - 1 - name), type);
    return 1;
}

static inline MarramStatus marram_set(MarramHostValues* values, const char* name, const char* toml) {
    MarramHostParsed parsed;
    MarramStatus status = MARRAM_ERROR;
    memset(&parsed, 0, sizeof parsed);
    if (!values || !name || !toml) return MARRAM_ERROR;
    size_t size = 0;
    const char* rest = marram_host_typed_part(values, name, &size);
    if (rest && strcmp(rest, "type") == 0) {
        if (marram_host_read(MARRAM_TEXT, toml, &parsed))
            marram_host_sets_type(values, name, parsed.text, &status);
        else
            marram_host_sets_type(values, name, toml, &status);
        marram_host_free_parsed(&parsed);
        return status;
    }
    const MarramParam* param = marram_host_declared(values, name);
    if (!param) return MARRAM_ERROR;
    const int readable = marram_host_read(param->type, toml, &parsed);
    return marram_host_check_and_accept(values, name, param, &parsed, readable, *toml ? toml : "empty");
}

static inline MarramStatus marram_host_set_parts(MarramHostValues* values, const char* name,
                                                 const double* numbers, size_t count, const char* text,
                                                 int (*takes)(const MarramTypeForm* form)) {
    MarramHostParsed parsed;
    memset(&parsed, 0, sizeof parsed);
    if (!values || !name || (count > 0 && !numbers)) return MARRAM_ERROR;
    const MarramParam* param = marram_host_declared(values, name);
    if (!param) return MARRAM_ERROR;
    for (size_t i = 0; i < count; ++i) marram_host_add_number(&parsed, numbers[i]);
    const MarramTypeForm* form = marram_type_form(param->type);
    if (count == 1 && (form->flags & MARRAM_OR_SCALAR))
        for (uint32_t i = 1; i < form->numbers; ++i) marram_host_add_number(&parsed, numbers[0]);
    if (text) {
        parsed.text = marram_host_copy(text, strlen(text));
        parsed.no_memory = parsed.no_memory || !parsed.text;
    }
    char given[160];
    if (text && !marram_host_is_text(form))
        snprintf(given, sizeof given, "%.40s of %lu numbers", text, (unsigned long)count);
    else if (text)
        snprintf(given, sizeof given, "%.140s", *text ? text : "empty");
    else if (count >= 1 && count <= 3)
        snprintf(given, sizeof given,
                 count == 1   ? "%g"
                 : count == 2 ? "%g, %g"
                              : "%g, %g, %g",
                 numbers[0], count > 1 ? numbers[1] : 0.0, count > 2 ? numbers[2] : 0.0);
    else
        snprintf(given, sizeof given, "%lu numbers", (unsigned long)count);
    return marram_host_check_and_accept(values, name, param, &parsed, takes(form), given);
}

static inline int marram_host_takes_numbers(const MarramTypeForm* form) {
    return form->numbers > 0 && !(form->flags & MARRAM_ITEMS);
}
static inline int marram_host_takes_ramp(const MarramTypeForm* form) {
    return (form->flags & MARRAM_ITEMS) && form->numbers == 2;
}
static inline int marram_host_takes_keys(const MarramTypeForm* form) {
    return (form->flags & MARRAM_ITEMS) && form->numbers == marram_host_key_numbers;
}

static inline MarramStatus marram_set_numbers(MarramHostValues* values, const char* name,
                                              const double* numbers, size_t count) {
    return marram_host_set_parts(values, name, numbers, count, NULL, marram_host_takes_numbers);
}

static inline MarramStatus marram_set_number(MarramHostValues* values, const char* name, double number) {
    return marram_set_numbers(values, name, &number, 1);
}

static inline MarramStatus marram_set_text(MarramHostValues* values, const char* name, const char* text) {
    MarramStatus status = MARRAM_ERROR;
    if (!values || !name || !text || marram_host_sets_type(values, name, text, &status)) return status;
    return marram_host_set_parts(values, name, NULL, 0, text, marram_host_is_text);
}

static inline MarramStatus marram_set_ramp(MarramHostValues* values, const char* name, const double* knots,
                                           size_t number_count, const char* interpolation) {
    return marram_host_set_parts(values, name, knots, number_count, interpolation ? interpolation : "",
                                 marram_host_takes_ramp);
}

static inline MarramStatus marram_set_keys(MarramHostValues* values, const char* name, const double* numbers,
                                           size_t number_count, const char* interpolation) {
    return marram_host_set_parts(values, name, numbers, number_count, interpolation ? interpolation : "",
                                 marram_host_takes_keys);
}

static inline MarramStatus marram_set_grid(MarramHostValues* values, const char* name, const MarramGrid* grid,
                                           const MarramPlacement* placement, const char* text) {
    MarramHostParsed parsed;
    memset(&parsed, 0, sizeof parsed);
    if (!values || !name) return MARRAM_ERROR;
    const MarramParam* param = marram_host_declared(values, name);
    if (!param) return MARRAM_ERROR;
    const uint32_t components = marram_type_form(param->type)->components; /* at most */
    const int fits = components > 0;
    const int whole = grid && grid->values && grid->nx && grid->ny && grid->nz && grid->components &&
                      grid->components <= components;
    if (!fits || !whole)
        return marram_host_refuse(
            values, name, values->place, fits ? "an image or table without values" : "a grid",
            fits ? marram_host_print("fill in all fields of the grid") : marram_host_wanted(param));
    parsed.text = marram_host_copy(text ? text : "", text ? strlen(text) : 0);
    const MarramStatus status =
        parsed.text ? marram_host_accept(values, name, param->type, &parsed) : MARRAM_ERROR;
    marram_host_free_parsed(&parsed);
    if (status != MARRAM_OK) {
        values->no_memory = 1;
        return status;
    }
    MarramHostSetting* setting = marram_host_find_setting(values, name);
    setting->grid = grid;
    setting->placement = placement;
    return MARRAM_OK;
}

static inline MarramStatus marram_set_curves(MarramHostValues* values, const char* name, const char* curves,
                                             const MarramAttribute* attributes, uint32_t attribute_count) {
    if (!values || !name || !curves) return MARRAM_ERROR;
    const MarramParam* param = marram_host_declared(values, name);
    if (!param) return MARRAM_ERROR;
    if (param->type != MARRAM_CURVES_NAME)
        return marram_host_refuse(values, name, values->place, "a name of curves", marram_host_wanted(param));
    const MarramStatus status = marram_set_text(values, name, curves);
    if (status != MARRAM_OK) return status;
    MarramHostSetting* setting = marram_host_find_setting(values, name);
    setting->attributes = attributes;
    setting->attribute_count = attributes ? attribute_count : 0;
    return MARRAM_OK;
}

static inline void marram_reset(MarramHostValues* values, const char* name) {
    MarramHostSetting* setting = values && name ? marram_host_find_setting(values, name) : NULL;
    if (values && name) marram_host_forget(values, name, 0);
    if (!setting) return;
    size_t size = 0;
    const char* rest = marram_host_typed_part(values, name, &size);
    if (rest && strcmp(rest, "type") == 0) return; /* there is no default */
    marram_host_free_setting(setting);
    *setting = values->settings[--values->setting_count];
}

static inline long marram_add(MarramHostValues* values, const char* list, const char* type) {
    char prefix[marram_host_longest_name + 16];
    long index = 0;
    if (!values || !list) return -1;
    marram_host_forget(values, list, 0);
    while (snprintf(prefix, sizeof prefix, "%.*s[%ld]", marram_host_longest_name, list, index) > 0 &&
           marram_host_find_element(values, prefix, strlen(prefix)))
        ++index;
    if (marram_host_find_item(values, list, strlen(list), NULL)) {
        char name[marram_host_longest_name + 32];
        snprintf(name, sizeof name, "%s.type", prefix);
        return marram_set_text(values, name, type ? type : "") == MARRAM_OK ? index : -1;
    }
    /* A list without types: check that a parameter is declared in it. */
    char inside[marram_host_longest_name + 32];
    size_t size = 0;
    snprintf(inside, sizeof inside, "%s.", prefix);
    const char* rest = marram_host_typed_part(values, inside, &size);
    MarramHostParams params = marram_host_params_of_type(values);
    if (rest) {
        const MarramHostElement* element =
            marram_host_find_element(values, inside, (size_t)(rest - 1 - inside));
        params.count = element && element->item ? element->item->param_count : 0;
        if (params.count) params = marram_host_params_of_item(element->item);
    }
    char* declared = marram_host_declared_name(rest ? rest : inside);
    int found = 0;
    for (uint32_t i = 0; declared && i < params.count; ++i)
        found = found || strncmp(MARRAM_AT(MarramParam, params.first, params.stride, i)->name, declared,
                                 strlen(declared)) == 0;
    if (!declared) values->no_memory = 1;
    free(declared);
    if (!found || type) {
        char* shown = marram_host_clean(list);
        char* what =
            shown ? marram_host_print(found ? "elements of %s have no types" : "%s is no list", shown) : NULL;
        free(shown);
        marram_host_complain(
            values, "host.list", list, values->place, what,
            found ? marram_host_print("leave out \"%.40s\"", type)
                  : marram_host_print("see `marram info %s` for what there is", values->type.name));
        return -1;
    }
    return marram_host_make_element(values, prefix, strlen(prefix)) ? index : -1;
}

/* ---- Finishing ---- */

/* For every parameter whose name is `declared` + field: adds the default of `given` + field, unless it was
 * set. */
static inline void marram_host_fill(MarramHostValues* values, MarramHostParams params, const char* declared,
                                    const char* given, const char* place) {
    const size_t size = strlen(declared);
    for (uint32_t i = 0; i < params.count; ++i) {
        const MarramParam* param = MARRAM_AT(MarramParam, params.first, params.stride, i);
        if (strncmp(param->name, declared, size) != 0 || strstr(param->name + size, "[].") ||
            param->type == MARRAM_UNAVAILABLE)
            continue;
        char* name = marram_host_print("%s%s", given, param->name + size);
        if (!name) {
            values->no_memory = 1;
            return;
        }
        const int required = *param->initial == '\0', absent = strcmp(param->initial, "none") == 0;
        if (marram_host_find_setting(values, name) || absent) {
            free(name);
            continue;
        }
        MarramHostParsed parsed;
        memset(&parsed, 0, sizeof parsed);
        if (required) {
            size_t said = 0; /* complaints that its value is wrong */
            for (size_t c = 0; c < values->complaint_count; ++c)
                said += strcmp(values->complaints[c].name, name) == 0;
            if (!said) {
                char* wanted = marram_host_wanted(param);
                marram_host_complain(values, "host.missing", name, place,
                                     marram_host_print("%s is missing", name),
                                     wanted ? marram_host_print("%s: %s", wanted, param->help) : NULL);
                free(wanted);
            }
        } else if (!marram_host_read(param->type, param->initial, &parsed) ||
                   marram_host_fault(param, &parsed) != MARRAM_GOOD) {
            marram_host_complain(
                values, "host.value", name, place,
                marram_host_print("the default of %s, %s, is no valid value", name, param->initial),
                marram_host_print("report it to the library's author, or set it"));
        } else if (!marram_host_store(NULL, &values->defaults, &values->default_count, &values->default_room,
                                      name, param->type, place, &parsed)) {
            values->no_memory = 1;
        }
        marram_host_free_parsed(&parsed);
        free(name);
    }
}

static inline void marram_host_fill_element(MarramHostValues* values, const MarramHostElement* element) {
    size_t list_size = 0;
    char* given = marram_host_print("%s.", element->name);
    const char* rest = given ? marram_host_typed_part(values, given, &list_size) : NULL;
    MarramHostParams params = marram_host_params_of_type(values);
    if (rest) {
        const MarramHostElement* top = marram_host_find_element(values, given, (size_t)(rest - 1 - given));
        if (!top || !top->item) { /* its type was wrong, which was reported */
            free(given);
            return;
        }
        params = marram_host_params_of_item(top->item);
    }
    char* declared = given ? marram_host_declared_name(rest ? rest : given) : NULL;
    if (declared)
        marram_host_fill(values, params, declared, given, element->place);
    else
        values->no_memory = 1;
    free(declared);
    free(given);
}

/* Checks that elements are numbered from 0 without gaps. */
static inline void marram_host_check_gap(MarramHostValues* values, const MarramHostElement* element) {
    const size_t size = strlen(element->name);
    size_t open = size;
    while (open > 0 && element->name[open] != '[') --open;
    const long index = strtol(element->name + open + 1, NULL, 10);
    if (index == 0) return;
    char* before = marram_host_print("%.*s[%ld]", (int)open, element->name, index - 1);
    if (!before)
        values->no_memory = 1;
    else if (!marram_host_find_element(values, before, strlen(before)))
        marram_host_complain(values, "host.list", element->name, element->place,
                             marram_host_print("there is %s, but no %s", element->name, before),
                             marram_host_print("number elements from 0 without gaps"));
    free(before);
}

static inline void marram_host_lend(const MarramHostSetting* setting, MarramValue* out) {
    static const double nothing = 0.0;
    memset(out, 0, sizeof *out);
    out->name = setting->name;
    out->type = setting->type;
    out->numbers = setting->numbers ? setting->numbers : &nothing;
    out->number_count = setting->number_count;
    out->text = setting->text;
    out->grid = setting->grid;
    out->place = setting->place;
    out->placement = setting->placement;
    out->attributes = setting->attributes;
    out->attribute_count = setting->attribute_count;
    out->attribute_stride = sizeof(MarramAttribute);
}

static inline const MarramValues* marram_values_finish(MarramHostValues* values, const MarramHost* host) {
    if (!values) return NULL;
    const size_t lasting = values->complaint_count; /* complaints added below are removed at the end */
    for (size_t i = 0; i < values->default_count; ++i) marram_host_free_setting(&values->defaults[i]);
    values->default_count = 0;
    free(values->list);
    values->list = NULL;
    marram_host_fill(values, marram_host_params_of_type(values), "", "", "");
    for (size_t i = 0; i < values->element_count; ++i) {
        marram_host_check_gap(values, &values->elements[i]);
        marram_host_fill_element(values, &values->elements[i]);
    }
    const size_t count = values->setting_count + values->default_count;
    values->list = (MarramValue*)calloc(count ? count : 1, sizeof *values->list);
    const int no_memory = values->no_memory || !values->list;
    values->no_memory = 0;
    const int good = values->complaint_count == 0 && !no_memory;
    for (size_t i = 0; i < values->complaint_count; ++i)
        marram_host_say(host, values->complaints[i].id, values->complaints[i].place,
                        values->complaints[i].what, values->complaints[i].remedy);
    if (no_memory)
        marram_host_say(host, "host.memory", "", "the values do not fit into memory", "set fewer elements");
    marram_host_forget(values, NULL, lasting);
    if (!good) return NULL;
    for (size_t i = 0; i < values->setting_count; ++i)
        marram_host_lend(&values->settings[i], &values->list[i]);
    for (size_t i = 0; i < values->default_count; ++i)
        marram_host_lend(&values->defaults[i], &values->list[values->setting_count + i]);
    values->lent.size = sizeof values->lent;
    values->lent.first = values->list;
    values->lent.count = (uint32_t)count;
    values->lent.stride = sizeof *values->list;
    return &values->lent;
}

static inline MarramHostValues* marram_values_new(const MarramProcedural* type) {
    MarramHostValues* values = type ? (MarramHostValues*)calloc(1, sizeof *values) : NULL;
    if (!values) return NULL;
    values->type = *type;
    values->place = marram_host_copy("", 0);
    if (values->place) return values;
    free(values);
    return NULL;
}

static inline void marram_values_free(MarramHostValues* values) {
    if (!values) return;
    for (size_t i = 0; i < values->setting_count; ++i) marram_host_free_setting(&values->settings[i]);
    for (size_t i = 0; i < values->default_count; ++i) marram_host_free_setting(&values->defaults[i]);
    for (size_t i = 0; i < values->element_count; ++i) {
        free(values->elements[i].name);
        free(values->elements[i].place);
    }
    marram_host_forget(values, NULL, 0);
    free(values->settings);
    free(values->defaults);
    free(values->elements);
    free(values->complaints);
    free(values->list);
    free(values->place);
    free(values);
}

static inline void marram_values_place(MarramHostValues* values, const char* place) {
    char* copy = values && place ? marram_host_copy(place, strlen(place)) : NULL;
    if (!copy) return; /* keep the previous place */
    free(values->place);
    values->place = copy;
}

/* ---- Finding a procedural ---- */

/* Why a host of this version cannot use it; NULL if it can. */
static inline const char* marram_host_unusable(const MarramProcedural* type) {
    const int curves = type->kind == MARRAM_CURVES;
    if ((type->param_count && !type->param_stride) || (type->item_type_count && !type->item_type_stride))
        return "it has an array whose stride is 0";
    if ((type->param_count && !type->params) || (type->item_type_count && !type->item_types))
        return "it has an array that is NULL";
    for (uint32_t t = 0; t <= type->item_type_count; ++t) { /* own parameters, then those of element types */
        const MarramItemType* item =
            t > 0 ? MARRAM_AT(MarramItemType, type->item_types, type->item_type_stride, t - 1) : NULL;
        const MarramParam* first = item ? item->params : type->params;
        const uint32_t stride = item ? item->param_stride : type->param_stride,
                       count = item ? item->param_count : type->param_count;
        if (item && (!item->list || !item->type || (count && (!stride || !first))))
            return "a text or array of its lists is missing";
        for (uint32_t i = 0; i < count; ++i) {
            const MarramParam* param = MARRAM_AT(MarramParam, first, stride, i);
            if (!param->name || !param->unit || !param->initial || !param->choices || !param->help)
                return "a text of its parameters is NULL";
            if ((unsigned)param->type >= (unsigned)MARRAM_PARAM_TYPE_COUNT)
                return "it has a parameter of a type that this version of the contract does not know";
        }
    }
    if (!curves && type->kind != MARRAM_MESH)
        return "its output is of a kind that this version of the contract does not know";
    if (!type->create || !type->begin || !type->destroy || (curves && (!type->patch || !type->tessellate)) ||
        (!curves && !type->mesh))
        return "it lacks a function that the contract asks for";
    return NULL;
}

static inline MarramStatus marram_find_procedural(const MarramLibrary* library, const char* name,
                                                  const MarramHost* host, MarramProcedural* out) {
    char what[256];
    MarramHostNearest nearest;
    if (!name || !out) return MARRAM_ERROR;
    if (!library || library->abi != MARRAM_ABI_VERSION) {
        snprintf(what, sizeof what, "the library speaks another version of the contract than %u",
                 MARRAM_ABI_VERSION);
        marram_host_say(host, "host.library", "", what, "build both with one marram_plugin.h");
        return MARRAM_ERROR;
    }
    if (library->embree_major != 0 && library->embree_major != MARRAM_EMBREE_MAJOR) {
        snprintf(what, sizeof what, "the library was built with Embree %u, this host with Embree %u",
                 (unsigned)library->embree_major, (unsigned)MARRAM_EMBREE_MAJOR);
        marram_host_say(host, "host.library", "", what, "build both with one Embree");
        return MARRAM_ERROR;
    }
    if (library->procedural_count && !library->procedural_stride) {
        marram_host_say(host, "host.library", "", "the library has an array whose stride is 0",
                        "give the size of its elements");
        return MARRAM_ERROR;
    }
    marram_host_seek(&nearest, name);
    for (uint32_t i = 0; i < library->procedural_count; ++i) {
        const size_t stride = library->procedural_stride;
        const MarramProcedural* one = MARRAM_AT(MarramProcedural, library->procedurals, stride, i);
        if (!one->name) continue;
        marram_host_offer(&nearest, one->name);
        if (strcmp(one->name, name) != 0) continue;
        memset(out, 0, sizeof *out);
        memcpy(out, one, stride < sizeof *out ? stride : sizeof *out);
        const char* why = marram_host_unusable(out);
        if (!why) return MARRAM_OK;
        snprintf(what, sizeof what, "\"%.60s\" cannot be used: %s", name, why);
        marram_host_say(host, "host.procedural", "", what, "use a library and a host of one version");
        return MARRAM_ERROR;
    }
    char remedy[marram_host_longest_name + 32];
    snprintf(remedy, sizeof remedy, "did you mean \"%s\"?", nearest.best);
    snprintf(what, sizeof what, "the library has no procedural \"%.60s\"", name);
    marram_host_say(host, "host.procedural", "", what,
                    nearest.best[0] ? remedy : "see `marram info` for what it has");
    return MARRAM_ERROR;
}

#if defined(__unix__) || defined(__APPLE__)
static inline MarramStatus marram_load_procedural(const char* path, const char* name, const MarramHost* host,
                                                  MarramProcedural* out) {
    MarramLibraryFunction entry = NULL;
    void* library = path ? dlopen(path, RTLD_NOW | RTLD_LOCAL) : NULL;
    void* symbol = library ? dlsym(library, MARRAM_ENTRY_POINT) : NULL;
    if (!symbol) {
        const char* why = path ? dlerror() : "no path";
        marram_host_say(host, "host.library", "", why ? why : "it has no procedurals",
                        "give the path of a procedural library");
        if (library) dlclose(library);
        return MARRAM_ERROR;
    }
    memcpy(&entry, &symbol, sizeof entry); /* C has no cast from an object pointer to a function pointer */
    return marram_find_procedural(entry(MARRAM_ABI_VERSION), name, host, out);
}
#endif

static inline void marram_print_message(void* user, const MarramMessage* m) {
    (void)user;
    fprintf(stderr, "%s%s%s%s%s\n", m->place, *m->place ? ": " : "", m->what, *m->remedy ? ": " : "",
            m->remedy);
}

static inline int marram_never_cancelled(void* user) {
    (void)user;
    return 0;
}

static inline MarramFrame marram_default_frame(const double* times, uint32_t time_count) {
    MarramFrame frame;
    memset(&frame, 0, sizeof frame);
    frame.size = sizeof frame;
    frame.fps = 24.0;
    frame.frame = times && time_count > 0 ? times[0] : 0.0;
    frame.bind_frame = 1.0;
    frame.time_count = time_count;
    frame.times = times;
    frame.stage = MARRAM_FINAL;
    frame.tolerance = 1e-3;
    frame.mesh_stride = sizeof(MarramMesh);
    frame.curves_stride = sizeof(MarramCurves);
    return frame;
}

static inline MarramMesh marram_static_mesh(const char* name, uint32_t geometry_id,
                                            const float* const* positions, uint32_t vertex_count,
                                            const uint32_t* triangles, uint32_t triangle_count) {
    MarramMesh mesh;
    memset(&mesh, 0, sizeof mesh);
    mesh.name = name;
    mesh.geometry_id = geometry_id;
    mesh.roles = MARRAM_ALL_ROLES;
    mesh.vertex_count = vertex_count;
    mesh.triangle_count = triangle_count;
    mesh.time_count = 1;
    mesh.positions = positions;
    mesh.triangles = triangles;
    return mesh;
}

static inline MarramStatus marram_host_pose_static(void* user, uint32_t index, double frame, float* positions,
                                                   float* normals) {
    const MarramMesh* mesh = (const MarramMesh*)user + index;
    const size_t bytes = 3 * sizeof(float) * (size_t)mesh->vertex_count;
    (void)frame;
    memcpy(positions, mesh->positions[0], bytes);
    if (normals && mesh->normals) memcpy(normals, mesh->normals[0], bytes);
    return MARRAM_OK;
}

static inline void marram_lend_static(MarramFrame* frame, const MarramMesh* meshes, uint32_t mesh_count) {
    frame->meshes = meshes;
    frame->mesh_count = mesh_count;
    frame->pose = marram_host_pose_static;
    frame->pose_user = (void*)meshes; /* only read */
}

static inline uint64_t marram_segment_count(const MarramOutput* output) {
    const uint64_t curves = output->curve_count;
    return (output->offsets ? output->offsets[curves] : curves * output->cvs_per_curve) - curves;
}

static inline void marram_segment_indices(const MarramOutput* output, uint32_t* indices) {
    uint32_t vertex = 0; /* Embree's indices have 32 bits */
    for (uint64_t c = 0; c < output->curve_count; ++c) {
        const uint64_t cvs =
            output->offsets ? output->offsets[c + 1] - output->offsets[c] : output->cvs_per_curve;
        for (uint64_t k = 0; k + 1 < cvs; ++k) *indices++ = vertex + (uint32_t)k;
        vertex += (uint32_t)cvs + 2;
    }
}

#ifdef __cplusplus
}
#endif
#endif
