/* SPDX-License-Identifier: Apache-2.0 */
/*
 * The types of parameters, for both sides of the contract. A new type is an enumerator and a row of the table in
 * this header, and what core/scene/param_types.h names for hosts.
 */
#ifndef MARRAM_TYPES_H
#define MARRAM_TYPES_H

#include <math.h>
#include <stddef.h>
#include <stdint.h>
#include <string.h>

#ifdef __cplusplus
extern "C" {
#endif

/* What a MarramValue of the type holds: numbers, text, grid, volume. */
typedef enum MarramParamType {
    MARRAM_BOOLEAN, /* numbers[0] is 0 or 1 */
    MARRAM_INTEGER, /* numbers[0], a whole number that fits into int32_t */
    MARRAM_NUMBER,  /* numbers[0] */
    MARRAM_VEC2,    /* numbers[0..1] */
    MARRAM_VEC3,    /* numbers[0..2] */
    MARRAM_RANGE,   /* numbers[0..1], low <= high */
    MARRAM_COLOR,   /* numbers[0..2], linear */
    MARRAM_TEXT,    /* text */
    MARRAM_CHOICE,  /* text, one of choices "a|b|c" */
    MARRAM_RAMP,    /* numbers = p0 v0 p1 v1 ..., text = "linear" | "smooth" | "constant" */
    MARRAM_IMAGE, /* grid: the host has read the file; rows from the top, linear values, nz = 1. text = its path */
    MARRAM_MESH_NAME, /* text = name of a mesh, scene's or procedural's, in MarramFrame.meshes: a dependency */
    MARRAM_KEYS, /* keyed transform: numbers = 10 per key: frame, translate xyz, rotate xyz in degrees, scale xyz,
                    frames ascending; text = "linear" | "smooth". Scale, then rotate about x, y, z, then translate */
    MARRAM_UNAVAILABLE, /* declared only for an error message if a scene uses it; never passed */
    MARRAM_CURVES_NAME, /* text = name of curves, scene's or procedural's, in MarramFrame.curves: a dependency */
    MARRAM_TABLE, /* grid: a table of numbers that the host has read from CSV, nx columns, ny rows, 1 component;
                     text = the columns' names, separated by commas */
    MARRAM_VOLUME, /* volume: vectors in space that the host has read, such as velocities. text = the file's path */
    MARRAM_PARAM_TYPE_COUNT
} MarramParamType;

typedef enum MarramTextKind {
    MARRAM_NO_TEXT = 0,
    MARRAM_ANY_TEXT,
    MARRAM_NAME_TEXT,   /* not empty */
    MARRAM_CHOICE_TEXT, /* one of MarramParam.choices */
    MARRAM_KEYWORD_TEXT /* one of MarramTypeForm.keywords */
} MarramTextKind;

/* MarramTypeForm.flags */
enum {
    MARRAM_WHOLE = 1, /* whole numbers of 32 bits */
    MARRAM_ZERO_OR_ONE = 2,
    MARRAM_OR_SCALAR = 4, /* as text, a single number may stand for all of them */
    MARRAM_ASCENDING = 8, /* from number to number; equal ones are allowed */
    MARRAM_NOT_NEGATIVE = 16,
    MARRAM_ITEMS =
        32 /* one or more items of so many numbers; the first number strictly ascends from item to item */
};

/* How values of a type are checked. */
typedef struct MarramTypeForm {
    const char* name;
    const char* written; /* as text, for messages: "give [low, high]" */
    uint32_t numbers;    /* how many; of each item if there are items */
    uint32_t flags;
    uint32_t range_bits; /* bit i: MarramParam.minimum and maximum apply to number i */
    /* [numbers] Limits of |x| for numbers whose range_bits bit is 0. Both NULL: any finite number. */
    const double *least_magnitude, *most_magnitude;
    MarramTextKind text;
    const char* keywords;
    uint32_t components; /* of a grid, at most; 0: no grid */
} MarramTypeForm;

/* NULL for a type that this header does not know. */
static inline const MarramTypeForm* marram_type_form(MarramParamType type) {
    /* frame, m, degrees, scale: limits that catch typing mistakes. */
    static const double key_least[10] = {0, 0, 0, 0, 0, 0, 0, 1e-6, 1e-6, 1e-6},
                        key_most[10] = {1e6, 1e8, 1e8, 1e8, 1e6, 1e6, 1e6, 1e6, 1e6, 1e6};
    static const MarramTypeForm forms[] = {
        {"boolean", "true or false", 1, MARRAM_ZERO_OR_ONE, 0, NULL, NULL, MARRAM_NO_TEXT, "", 0},
        {"integer", "a whole number", 1, MARRAM_WHOLE, 1, NULL, NULL, MARRAM_NO_TEXT, "", 0},
        {"number", "a number", 1, 0, 1, NULL, NULL, MARRAM_NO_TEXT, "", 0},
        {"vec2", "two numbers [a, b]", 2, 0, 3, NULL, NULL, MARRAM_NO_TEXT, "", 0},
        {"vec3", "three numbers [x, y, z]", 3, 0, 7, NULL, NULL, MARRAM_NO_TEXT, "", 0},
        {"range", "[low, high], or one number for both", 2, MARRAM_OR_SCALAR | MARRAM_ASCENDING, 3, NULL,
         NULL, MARRAM_NO_TEXT, "", 0},
        {"color", "[r, g, b], or one number for a grey", 3, MARRAM_OR_SCALAR | MARRAM_NOT_NEGATIVE, 7, NULL,
         NULL, MARRAM_NO_TEXT, "", 0},
        {"text", "a text", 0, 0, 0, NULL, NULL, MARRAM_ANY_TEXT, "", 0},
        {"choice", "one of its choices", 0, 0, 0, NULL, NULL, MARRAM_CHOICE_TEXT, "", 0},
        {"ramp", "[[position, value], ...] with ascending positions, values", 2, MARRAM_ITEMS, 2, NULL, NULL,
         MARRAM_KEYWORD_TEXT, "linear|smooth|constant", 0},
        {"image", "an image", 0, 0, 0, NULL, NULL, MARRAM_ANY_TEXT, "", 4},
        {"reference", "the name of a mesh", 0, 0, 0, NULL, NULL, MARRAM_NAME_TEXT, "", 0},
        {"keys",
         "{ translate = [x, y, z], rotate = ..., scale = ... }, or { keys = [{ frame = 1, ... }, ...], "
         "interpolation = \"linear|smooth\" }",
         10, MARRAM_ITEMS, 0, key_least, key_most, MARRAM_KEYWORD_TEXT, "linear|smooth", 0},
        {"unavailable", "nothing", 0, 0, 0, NULL, NULL, MARRAM_NO_TEXT, "", 0},
        {"reference", "the name of curves", 0, 0, 0, NULL, NULL, MARRAM_NAME_TEXT, "", 0},
        {"table", "a table", 0, 0, 0, NULL, NULL, MARRAM_ANY_TEXT, "", 1},
        {"volume", "a volume", 0, 0, 0, NULL, NULL, MARRAM_ANY_TEXT, "", 0},
    };
    /* Does not compile if a type has no row. Rows are in the order of MarramParamType. */
    (void)sizeof(char[sizeof forms / sizeof *forms == (size_t)MARRAM_PARAM_TYPE_COUNT ? 1 : -1]);
    return (unsigned)type < (unsigned)MARRAM_PARAM_TYPE_COUNT ? &forms[type] : NULL;
}

/* Whether `text` is one of "a|b|c". */
static inline int marram_is_listed(const char* choices, const char* text) {
    const size_t size = strlen(text);
    for (;;) {
        const size_t one = strcspn(choices, "|");
        if (one == size && strncmp(choices, text, size) == 0) return 1;
        if (choices[one] == '\0') return 0;
        choices += one + 1;
    }
}

typedef enum MarramValueFault {
    MARRAM_GOOD = 0,
    MARRAM_WRONG_COUNT,  /* of numbers */
    MARRAM_WRONG_NUMBER, /* *index: of the number */
    MARRAM_WRONG_ORDER, /* numbers[*index] is less than the one before, or not greater than that of the item before */
    MARRAM_WRONG_TEXT
} MarramValueFault;

static inline int marram_number_is_good(const MarramTypeForm* form, uint32_t i, double minimum,
                                        double maximum, double x) {
    if (!isfinite(x)) return 0;
    if ((form->flags & MARRAM_ZERO_OR_ONE) && x != 0.0 && x != 1.0) return 0;
    if ((form->flags & MARRAM_WHOLE) && (x != floor(x) || !(fabs(x + 0.5) < 2147483648.0))) return 0;
    if ((form->flags & MARRAM_NOT_NEGATIVE) && x < 0.0) return 0;
    if (form->range_bits >> i & 1u) return x >= minimum && x <= maximum;
    return !form->most_magnitude ||
           (fabs(x) >= form->least_magnitude[i] && fabs(x) <= form->most_magnitude[i]);
}

/* Checks numbers and text against the form and a parameter's range and choices. text: NULL counts as "". Grids are
 * not checked. *index counts only with MARRAM_WRONG_NUMBER and MARRAM_WRONG_ORDER. */
static inline MarramValueFault marram_value_fault(const MarramTypeForm* form, double minimum, double maximum,
                                                  const char* choices, const double* numbers, size_t count,
                                                  const char* text, size_t* index) {
    const size_t each = form->numbers;
    const int items = (form->flags & MARRAM_ITEMS) != 0;
    const char* given = text ? text : "";
    *index = 0;
    if (each == 0) count = 0; /* a type without numbers ignores those that are given */
    if (items ? count == 0 || count % each != 0 : count != each) return MARRAM_WRONG_COUNT;
    for (size_t i = 0; i < count; ++i) {
        *index = i;
        if (!marram_number_is_good(form, (uint32_t)(i % each), minimum, maximum, numbers[i]))
            return MARRAM_WRONG_NUMBER;
        if (items && i >= each && i % each == 0 && !(numbers[i] > numbers[i - each]))
            return MARRAM_WRONG_ORDER;
        if ((form->flags & MARRAM_ASCENDING) && i > 0 && numbers[i] < numbers[i - 1])
            return MARRAM_WRONG_ORDER;
    }
    if (form->text == MARRAM_NAME_TEXT && !*given) return MARRAM_WRONG_TEXT;
    if (form->text == MARRAM_CHOICE_TEXT && !marram_is_listed(choices, given)) return MARRAM_WRONG_TEXT;
    if (form->text == MARRAM_KEYWORD_TEXT && !marram_is_listed(form->keywords, given))
        return MARRAM_WRONG_TEXT;
    return MARRAM_GOOD;
}

#ifdef __cplusplus
}
#endif
#endif
