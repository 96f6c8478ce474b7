// SPDX-License-Identifier: Apache-2.0
// Each setting is applied to a copy of the file's tree by the code of --set. Where the two trees differ the
// text is edited, and parsed again, until they are equal. toml++ knows where values begin; where they end,
// and which lines make a table, is scanned here.
#include "core/scene/edit.h"
#include "core/math/text.h"
#include "core/scene/parse.h"
#include "core/scene/suggest.h"
#include "core/scene/value_text.h"

#include <algorithm>
#include <array>
#include <fmt/format.h>
#include <map>
#include <sstream>

namespace marram {
namespace {

// Keys from the root on; "[2]" is an element of a list.
using KeyPath = std::vector<std::string>;
using Entries = std::vector<std::pair<std::string, const toml::node*>>;

bool is_within(const KeyPath& path, const KeyPath& outer) {
    return outer.size() <= path.size() && std::equal(outer.begin(), outer.end(), path.begin());
}

KeyPath extended(KeyPath path, const std::string& key) {
    path.push_back(key);
    return path;
}

// What a table or list contains; nothing for other nodes.
Entries entries_of(const toml::node& node) {
    Entries entries;
    if (const toml::table* table = node.as_table())
        for (const auto& [key, inner] : *table) entries.emplace_back(std::string(key.str()), &inner);
    if (const toml::array* list = node.as_array())
        for (size_t i = 0; i < list->size(); ++i) entries.emplace_back(fmt::format("[{}]", i), list->get(i));
    return entries;
}

// The same type and value: 4 is not 4.0. (nan, which no scene may contain, differs from itself.)
bool is_same(const toml::node& a, const toml::node& b) {
    return toml::node_view<const toml::node>(a) == toml::node_view<const toml::node>(b);
}

std::string key_text(const std::string& key) {
    constexpr std::string_view bare = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789_-";
    return key.empty() || key.find_first_not_of(bare) != std::string::npos ? quoted_text(key) : key;
}

// The keys with dots between them. Elements of lists have none in a header.
std::string dotted(const KeyPath& keys) {
    std::string out;
    for (const std::string& key : keys)
        if (!key.starts_with('[')) out += (out.empty() ? "" : ".") + key_text(key);
    return out;
}

bool is_quote(char c) { return c == '"' || c == '\''; }
bool is_blank(char c) { return c == ' ' || c == '\t'; }

size_t string_end(std::string_view text, size_t begin) {
    const char quote = text[begin];
    const std::string three(3, quote);
    const bool multiline = text.substr(begin).starts_with(three);
    size_t at = begin + (multiline ? 3 : 1);
    while (at < text.size() && (multiline ? !text.substr(at).starts_with(three) : text[at] != quote))
        at += text[at] == '\\' && quote == '"' ? 2 : 1;
    at += multiline ? 3 : 1;
    while (multiline && at < text.size() && text[at] == quote) ++at; // quotes before the three that close
    return std::min(at, text.size());
}

// Moves `at` past a string, a comment or one other character.
void skip(std::string_view text, size_t& at) {
    if (is_quote(text[at]))
        at = string_end(text, at);
    else
        at = text[at] == '#' ? std::min(text.find('\n', at), text.size()) : at + 1;
}

// The end of the value or header that begins at `at`.
size_t value_end(std::string_view text, size_t at) {
    if (is_quote(text[at])) return string_end(text, at);
    if (text[at] != '[' && text[at] != '{') {
        const size_t end = std::min(text.find_first_of(",]}#\r\n", at), text.size());
        return text.find_last_not_of(" \t", end - 1) + 1;
    }
    int depth = 0;
    do {
        depth += text[at] == '[' || text[at] == '{' ? 1 : text[at] == ']' || text[at] == '}' ? -1 : 0;
        skip(text, at);
    } while (depth > 0 && at < text.size());
    return at;
}

// Lines count from 1, and so do columns, in code points.
size_t offset_of(std::string_view text, const toml::source_position& place) {
    const auto continues = [&](size_t i) { return (static_cast<unsigned char>(text[i]) & 0xc0U) == 0x80U; };
    size_t at = 0;
    for (auto line = place.line; line > 1; --line) at = text.find('\n', at) + 1;
    for (auto column = place.column; column > 1; --column)
        for (++at; at < text.size() && continues(at);) ++at;
    return at;
}

// A header, or a key and its value.
struct Statement {
    KeyPath path;
    size_t header_parts = 0; // of the path: those of the header that it stands below
    bool is_header = false;
    size_t line = 0, equals = 0, end = 0; // offsets: of its first line, of its =, after the value or header
};

struct Document {
    std::string text;
    toml::table tree;
    std::vector<Statement> statements;
};

// The keys of "[a.b]" or "a.b = 0".
KeyPath keys_of(const std::string& text) {
    KeyPath keys;
    const toml::table root = toml::parse(text);
    for (Entries entries = entries_of(root); !entries.empty(); entries = entries_of(*entries[0].second))
        if (entries[0].first != "[0]") keys.push_back(entries[0].first);
    return keys;
}

std::vector<Statement> statements_of(const std::string& text) {
    std::vector<Statement> all;
    std::map<KeyPath, size_t> sizes; // of lists of tables
    KeyPath table;
    for (size_t line = 0, at = 0; (at = text.find_first_not_of(" \t\r\n", line)) != std::string::npos;) {
        Statement one;
        one.line = at == 0 ? 0 : text.rfind('\n', at - 1) + 1;
        if (text[at] == '[') {
            one.is_header = true;
            one.end = value_end(text, at);
            const KeyPath keys = keys_of(text.substr(at, one.end - at));
            for (const std::string& key : keys) {
                one.path.push_back(key);
                if (&key == &keys.back() && text[at + 1] == '[') ++sizes[one.path];
                if (const auto size = sizes.find(one.path); size != sizes.end())
                    one.path.push_back(fmt::format("[{}]", size->second - 1));
            }
            table = one.path;
        } else if (text[at] != '#') {
            for (one.equals = at; text[one.equals] != '=';) skip(text, one.equals);
            one.end = value_end(text, text.find_first_not_of(" \t", one.equals + 1));
            one.path = table;
            for (const std::string& key : keys_of(text.substr(at, one.equals - at) + "= 0"))
                one.path.push_back(key);
        }
        one.header_parts = table.size();
        line = std::min(text.find('\n', std::max(at, one.end)), text.size());
        if (text[at] != '#') all.push_back(std::move(one));
    }
    return all;
}

Document read_document(std::string text, const std::string& file) {
    if (const std::optional<Place> place = deep_key(text))
        throw InputError({file, place->line, place->column},
                         fmt::format("a key has more than {} parts", max_parts), "take the dots out");
    try {
        toml::table tree = toml::parse(text, std::string_view(file));
        std::vector<Statement> statements = statements_of(text);
        return {std::move(text), std::move(tree), std::move(statements)};
    } catch (const toml::parse_error& error) {
        const toml::source_position place = error.source().begin;
        throw InputError({file, static_cast<int>(place.line), static_cast<int>(place.column)},
                         std::string(error.description()),
                         "use TOML syntax (key = value, texts in quotes; see toml.io)");
    }
}

// The value that a setting has put into a tree.
struct NewValue {
    const toml::node* node = nullptr;
    std::vector<const toml::node*> made; // tables around it that --set has added, from outside
    std::string text;                    // "value = ...": the node and its parts have their places in it

    // Whether the node is the value or a part of it. Those from the file have no source, as they are copies.
    bool has(const toml::node& one) const {
        return one.source().path && std::ranges::find(made, &one) == made.end();
    }
};

// The topmost node that is not from the file.
const toml::node* new_node(const toml::node& node) {
    if (node.source().path) return &node;
    for (const auto& [key, inner] : entries_of(node))
        if (const toml::node* found = new_node(*inner)) return found;
    return nullptr;
}

// Names of items may contain =, so each = is tried.
NewValue new_value(const toml::table& wanted, const std::string& setting) {
    const toml::node* top = new_node(wanted);
    for (size_t equals = setting.find('='); top && equals != std::string::npos;
         equals = setting.find('=', equals + 1)) {
        std::string text = setting.substr(equals + 1);
        text.erase(0, text.find_first_not_of(" \t"));
        text.erase(text.find_last_not_of(" \t") + 1);
        toml::table parsed = parse_value(text, "");
        if (parsed.empty()) parsed = parse_value(text = quoted_text(text), "");
        NewValue value{top, {}, "value = " + text};
        while (!parsed.empty() && value.node) {
            if (is_same(*value.node, *parsed.get("value"))) return value;
            value.made.push_back(value.node);
            const Entries inner = entries_of(*value.node);
            value.node = inner.size() == 1 ? inner[0].second : nullptr;
        }
    }
    return {};
}

// Takes a node out of the tables around it, and those that this leaves empty.
bool take_out(toml::node& node, const toml::node* which) {
    if (&node == which) return true;
    bool changed = false;
    if (toml::table* table = node.as_table())
        for (const auto& [key, inner] : entries_of(node))
            if (take_out(*table->get(key), which)) changed = table->erase(key) > 0;
    if (toml::array* list = node.as_array())
        for (toml::node& element : *list) take_out(element, which);
    return changed && node.as_table()->empty();
}

struct Edit {
    size_t begin = 0, end = 0;
    std::string text; // lines end in \n
};

// Collects the edits that turn a document into the wanted tree.
class Differences {
  public:
    Differences(const Document& document, const toml::table& wanted, const NewValue& value)
        : all_(document.statements), text_(document.text), value_(value) {
        compare(document.tree, wanted, {});
    }
    std::vector<Edit> edits;

  private:
    void compare(const toml::node& own, const toml::node& wanted, const KeyPath& path) {
        if (is_same(own, wanted)) return;
        const bool in_value = statement_around(path), has_text = in_value && !is_dotted(own);
        const Entries had = entries_of(own), has = entries_of(wanted);
        if (const toml::table* table = wanted.as_table(); table && own.is_table()) {
            const bool keeps_keys =
                std::ranges::all_of(had, [&](const auto& entry) { return table->contains(entry.first); });
            if (!has_text || keeps_keys || !value_.has(wanted)) {
                Entries added;
                compare_keys(*own.as_table(), *table, path, "", added);
                if (!added.empty() && in_value) return add_entries(own, added);
                return added.empty() ? void() : add_lines(path, added);
            }
        }
        const bool has_tables =
            std::ranges::all_of(has, [](const auto& one) { return one.second->is_table(); });
        if (own.is_array() && wanted.is_array() && had.size() == has.size() && (in_value || has_tables)) {
            for (size_t i = 0; i < has.size(); ++i)
                compare(*had[i].second, *has[i].second, extended(path, has[i].first));
        } else if (has_text) {
            const size_t begin = offset_of(text_, own.source().begin);
            edits.push_back({begin, value_end(text_, begin), text_of(wanted)});
        } else {
            remove(own, path); // what replaces it is added in the next round
        }
    }

    // Collects the texts of new keys and their values. A dotted table within an inline one has no end of
    // its own: its new keys are those of the inline table, with a prefix.
    void compare_keys(const toml::table& own, const toml::table& wanted, const KeyPath& path,
                      const std::string& prefix, Entries& added) {
        for (const auto& [key, node] : entries_of(own))
            if (!wanted.contains(key)) remove(*node, extended(path, key));
        for (const auto& [key, node] : entries_of(wanted)) {
            const toml::node* old = own.get(key);
            const KeyPath inner = extended(path, key);
            if (old && is_dotted(*old) && node->is_table() && statement_around(inner))
                compare_keys(*old->as_table(), *node->as_table(), inner, prefix + key_text(key) + ".", added);
            else if (old)
                compare(*old, *node, inner);
            else if (path.empty() && node->is_table())
                add_table(key_text(key), *node);
            else
                added.emplace_back(prefix + key_text(key), node);
        }
    }

    // The key whose value contains this node; nullptr: the node is made by headers or dotted keys.
    const Statement* statement_around(const KeyPath& path) const {
        const auto contains = [&](const Statement& one) {
            return !one.is_header && is_within(path, one.path);
        };
        const auto around = std::ranges::find_if(all_, contains);
        return around == all_.end() ? nullptr : &*around;
    }

    // A table without a text of its own, such as `a` in { a.b = 1 }.
    static bool is_dotted(const toml::node& node) { return node.is_table() && !node.as_table()->is_inline(); }

    std::string given_text(const toml::node& node) const {
        const size_t begin = offset_of(value_.text, node.source().begin);
        return value_.text.substr(begin, value_end(value_.text, begin) - begin);
    }

    static bool is_list_of_tables(const toml::node& node) {
        const toml::array* list = node.as_array();
        return list && list->size() > 1 &&
               std::ranges::all_of(*list, [](const toml::node& one) { return one.is_table(); });
    }

    // An element a line. A list that is written over several lines stays as it is.
    std::string list_text(const toml::array& list) const {
        if (given_text(list).find('\n') != std::string::npos) return given_text(list);
        std::string out = "[";
        for (const toml::node& one : list) out += "\n    " + given_text(one) + ",";
        return out + "\n]";
    }

    std::string text_of(const toml::node& node) const {
        if (value_.has(node) && !is_dotted(node)) {
            if (is_list_of_tables(node)) return list_text(*node.as_array());
            return given_text(node);
        }
        if (!node.is_table()) return ""; // the check of the result reports it
        std::string out;
        for (const auto& [key, inner] : entries_of(node))
            out += fmt::format("{} {} = {}", out.empty() ? "" : ",", key_text(key), text_of(*inner));
        return "{" + out + " }";
    }

    // "\nkey = value" for each entry, in the style of a statement.
    std::string lines_of(const Entries& entries, const std::string& prefix, const Statement* like) const {
        std::string indent, out;
        for (size_t at = like ? like->line : text_.size(); at < text_.size() && is_blank(text_[at]); ++at)
            indent += text_[at];
        const auto key = std::ranges::find(all_, false, &Statement::is_header);
        if ((!like || like->is_header) && key != all_.end()) like = &*key;
        const bool tight = like && !like->is_header && !is_blank(text_[like->equals - 1]);
        for (const auto& [name, node] : entries)
            out += "\n" + indent + prefix + name + (tight ? "=" : " = ") + text_of(*node);
        return out;
    }

    // Adds keys to a table that has lines of its own, or only headers of tables within it.
    void add_lines(const KeyPath& path, const Entries& added) {
        const Statement *after = nullptr, *inner = nullptr;
        for (const Statement& one : all_) {
            if (!is_within(one.path, path)) continue;
            if (one.header_parts <= path.size())
                after = &one; // its header or its last key, which may be dotted
            else if (!inner)
                inner = &one;
        }
        if (!after && path.empty()) return add_block(nullptr, lines_of(added, "", nullptr));
        if (!after) {
            const size_t at = above_comments(inner->line);
            const std::string lines = lines_of(added, "", nullptr);
            return edits.push_back({at, at, fmt::format("[{}]{}\n\n", dotted(path), lines)});
        }
        std::string prefix = dotted({path.begin() + std::ptrdiff_t(after->header_parts), path.end()});
        if (!prefix.empty()) prefix += ".";
        size_t at = line_end(after->end);
        if (text_.find('#', after->end) < at) // the comment may go on, indented
            while (first_char(next_line(at)) == '#' && is_blank(text_[next_line(at)]))
                at = line_end(next_line(at));
        edits.push_back({at, at, lines_of(added, prefix, after)});
    }

    // Adds [name] after the table that comes before it.
    void add_table(const std::string& name, const toml::node& table) {
        constexpr std::array<std::string_view, 3> order = {"camera", "film", "wind"};
        const auto place = std::ranges::find(order, name);
        const Statement* after = nullptr; // the last global key; of other tables the end of the file
        for (const Statement& one : all_)
            if (one.header_parts == 0 || place == order.end()) after = &one;
        for (auto before = order.begin(); place != order.end() && before != place; ++before)
            for (const Statement& one : all_)
                if (one.path[0] == *before) after = &one;
        Entries entries = entries_of(table);
        for (auto& [key, node] : entries) key = key_text(key);
        add_block(after, fmt::format("\n\n[{}]{}", name, lines_of(entries, "", nullptr)));
    }

    // Adds lines after a statement or, without one, after the comment that the file begins with.
    void add_block(const Statement* after, std::string lines) {
        size_t at = after ? line_end(after->end) : first_char(0) == '#' ? line_end(0) : 0;
        size_t end = at; // of the comment below
        while (first_char(next_line(end)) == '#') end = line_end(next_line(end));
        if (at > 0 && (!after || first_char(next_line(end)) == '\n')) at = end;
        if (at == 0) lines = lines.substr(lines.find_first_not_of('\n')) + "\n";
        if (at == 0 ? !text_.empty() : first_char(next_line(at)) != '\n') lines += "\n";
        edits.push_back({at, at, lines});
    }

    // Adds entries to an inline table, after its last value.
    void add_entries(const toml::node& table, const Entries& added) {
        const std::vector<size_t> values = offsets_in(table);
        const size_t last = values.empty() ? 0 : *std::ranges::max_element(values);
        const bool tight = last > 0 && !is_blank(text_[text_.rfind('=', last) - 1]);
        std::string entries;
        for (const auto& [name, node] : added)
            entries += fmt::format("{} {}{}{}", entries.empty() && last == 0 ? "" : ",", name,
                                   tight ? "=" : " = ", text_of(*node));
        if (last == 0) entries = "{" + entries + " }";
        const size_t begin = offset_of(text_, table.source().begin);
        const size_t end = value_end(text_, last == 0 ? begin : last);
        edits.push_back({last == 0 ? begin : end, end, entries});
    }

    // Offsets of the values of an inline table, and of the dotted tables in it.
    std::vector<size_t> offsets_in(const toml::node& node) const {
        std::vector<size_t> offsets;
        for (const auto& [key, inner] : entries_of(node))
            if (is_dotted(*inner))
                std::ranges::copy(offsets_in(*inner), std::back_inserter(offsets));
            else
                offsets.push_back(offset_of(text_, inner->source().begin));
        return offsets;
    }

    void remove(const toml::node& node, const KeyPath& path) {
        if (const Statement* around = statement_around(path); around && around->path.size() < path.size()) {
            const size_t begin = is_dotted(node) ? 0 : offset_of(text_, node.source().begin);
            for (const size_t value : is_dotted(node) ? offsets_in(node) : std::vector{begin})
                remove_entry(around->equals + 1, value);
            return;
        }
        for (size_t i = 0; i < all_.size(); ++i) {
            if (!is_within(all_[i].path, path)) continue;
            const Statement& first = all_[i];
            while (first.is_header && i + 1 < all_.size() && !all_[i + 1].is_header) ++i;
            size_t end = next_line(all_[i].end);
            while (first.is_header && end < text_.size() && first_char(end) == '\n') end = next_line(end);
            edits.push_back({first.line, end, ""});
        }
    }

    // Removes the entry with this value from the inline table around it. `at` is outside of that.
    void remove_entry(size_t at, size_t value) {
        std::vector<size_t> begins; // of the entry in each open bracket
        for (; at < value; skip(text_, at))
            if (text_[at] == '[' || text_[at] == '{')
                begins.push_back(at + 1);
            else if (text_[at] == ']' || text_[at] == '}')
                begins.pop_back();
            else if (text_[at] == ',')
                begins.back() = at + 1;
        size_t begin = begins.back(), end = value_end(text_, value);
        const size_t next = text_.find_first_not_of(" \t", end);
        if (text_[next] == ',')
            end = next + 1;
        else if (text_[begin - 1] == ',')
            --begin;
        edits.push_back({begin, end, ""});
    }

    // The end of a line, without the characters that end it.
    size_t line_end(size_t at) const {
        const size_t end = std::min(text_.find('\n', at), text_.size());
        return end > at && text_[end - 1] == '\r' ? end - 1 : end;
    }
    size_t next_line(size_t at) const { return std::min(text_.find('\n', at), text_.size() - 1) + 1; }
    // The first character of a line that is not blank; \n: there is none.
    char first_char(size_t line) const {
        const size_t at = text_.find_first_not_of(" \t\r", line);
        return at == std::string::npos ? '\n' : text_[at];
    }
    size_t above_comments(size_t line) const {
        for (size_t above = line; above > 1;) {
            above = text_.rfind('\n', above - 2) + 1;
            if (first_char(above) != '#') break;
            line = above;
        }
        return line;
    }

    const std::vector<Statement>& all_;
    const std::string& text_;
    const NewValue& value_;
};

// Applies edits from front to back. One that overlaps another waits for the next round.
std::string edited(const std::string& text, std::vector<Edit> edits) {
    const size_t first = text.find('\n');
    const bool crlf = first != std::string::npos && first > 0 && text[first - 1] == '\r';
    std::ranges::stable_sort(edits, {}, &Edit::begin);
    std::string out;
    size_t at = 0;
    for (const Edit& edit : edits) {
        if (edit.begin < at) continue;
        out.append(text, at, edit.begin - at);
        for (const char c : edit.text)
            if (c == '\n')
                out += crlf ? "\r\n" : "\n";
            else if (c != '\r')
                out += c;
        at = edit.end;
    }
    return out.append(text, at);
}

// Edits the document until it parses to the wanted tree.
void write_setting(Document& document, toml::table& wanted, const std::string& setting,
                   const std::string& file) {
    const NewValue value = new_value(wanted, setting);
    if (value.node && value.node->is_table() && value.node->as_table()->empty()) take_out(wanted, value.node);
    constexpr int max_rounds = 8; // two or three are needed
    try {
        for (int round = 0; round < max_rounds; ++round) {
            if (is_same(document.tree, wanted)) return;
            const Differences differences(document, wanted, value);
            document = read_document(edited(document.text, differences.edits), file);
        }
    } catch (const InputError&) {
    }
    throw InputError({"--set " + clean(setting), 0, 0}, "the value has no place in the text of the scene",
                     "write it into the file by hand");
}

// The place where two trees differ, in the first of them; nullptr: it has nothing there, or they are the
// same.
const toml::node* first_difference(const toml::node& node, const toml::node& other) {
    const bool tables = node.is_table() && other.is_table();
    const bool lists =
        node.is_array() && other.is_array() && node.as_array()->size() == other.as_array()->size();
    if (!tables && !lists) return &node;
    const Entries inner = entries_of(node), inner_of_other = entries_of(other);
    for (const auto& [key, one] : inner)
        for (const auto& [other_key, another] : inner_of_other)
            if (key == other_key && !is_same(*one, *another)) return first_difference(*one, *another);
    return nullptr;
}

// On one line.
std::string inline_text(const toml::node& node) {
    std::string out;
    for (const auto& [key, inner] : entries_of(node))
        out +=
            (out.empty() ? "" : ", ") + (node.is_table() ? key_text(key) + " = " : "") + inline_text(*inner);
    if (node.is_table()) return out.empty() ? "{}" : "{ " + out + " }";
    if (node.is_array()) return "[" + out + "]";
    if (const auto* text = node.as_string()) return quoted_text(text->get());
    std::ostringstream number;
    node.visit([&](const auto& own) {
        if constexpr (toml::is_value<decltype(own)>) number << own;
    });
    return number.str();
}

} // namespace

std::optional<std::string> value_in_scene(const std::string& text, const std::string& file,
                                          const std::vector<std::string>& settings, const std::string& key) {
    Document document = read_document(text.substr(byte_order_mark(file, text)), file);
    Reading reading;
    reading.file = file;
    apply_settings(document.tree, settings, reading);
    toml::table other(document.tree);
    const size_t known = reading.problems.size();
    apply_settings(other, {key + "=\"value that no scene has\""}, reading);
    if (reading.problems.size() > known) return {};
    const toml::node* const found = first_difference(document.tree, other);
    return found ? std::optional(inline_text(*found)) : std::nullopt;
}

std::string edited_scene(const std::string& text, const std::string& file,
                         std::span<const std::string> settings) {
    const size_t mark = byte_order_mark(file, text);
    Document document = read_document(text.substr(mark), file);
    Reading reading;
    reading.file = file;
    for (const std::string& setting : settings) {
        toml::table wanted(document.tree);
        const size_t known = reading.problems.size();
        apply_settings(wanted, {setting}, reading);
        if (reading.problems.size() == known) write_setting(document, wanted, setting, file);
    }
    throw_problems(reading);
    return text.substr(0, mark) + document.text;
}

} // namespace marram
