// SPDX-License-Identifier: Apache-2.0
#include "core/host/geometry_graph.h"

#include <algorithm>

namespace marram {

bool depends_on(const Procedural& procedural, const Procedural& other) {
    if (other.kind() == MARRAM_MESH) return depends_on_mesh(procedural, other.name(), other.roles);
    return procedural.refers_to_curves(other.name());
}

namespace {

// Depth-first search. A procedural that is reached again while open closes a cycle.
class Sort {
  public:
    explicit Sort(std::span<const std::unique_ptr<Procedural>> procedurals)
        : procedurals_(procedurals), seen_(procedurals.size(), Seen::no) {}

    std::vector<size_t> order() {
        for (size_t i = 0; i < procedurals_.size(); ++i) visit(i);
        return std::move(order_);
    }

  private:
    enum class Seen : uint8_t { no, open, done };

    void visit(size_t i) {
        if (seen_[i] == Seen::done) return;
        path_.push_back(i);
        if (seen_[i] == Seen::open) refuse();
        seen_[i] = Seen::open;
        for (size_t other = 0; other < procedurals_.size(); ++other)
            if (depends_on(*procedurals_[i], *procedurals_[other])) visit(other);
        seen_[i] = Seen::done;
        path_.pop_back();
        order_.push_back(i);
    }

    [[noreturn]] void refuse() const {
        const auto begin = std::ranges::find(path_, path_.back());
        std::string ring;
        for (auto it = begin; it != path_.end(); ++it)
            ring += (it == begin ? "" : " -> ") + procedurals_[*it]->name();
        Problem problem;
        problem.place = procedurals_[*begin]->place();
        problem.what = "procedurals depend on each other in a ring: " + ring;
        problem.fix = "break the cycle: let one of them use other geometry, or set collides and shelters of "
                      "one of its meshes to false";
        problem.id = "graph.ring";
        throw InputError({std::move(problem)});
    }

    std::span<const std::unique_ptr<Procedural>> procedurals_;
    std::vector<Seen> seen_;
    std::vector<size_t> path_, order_;
};

} // namespace

bool depends_on_mesh(const Procedural& procedural, const std::string& mesh, uint32_t roles) {
    const bool traced =
        procedural.kind() == MARRAM_CURVES && (roles & (MARRAM_COLLIDES | MARRAM_SHELTERS)) != 0;
    return traced || procedural.refers_to_mesh(mesh);
}

namespace {

void check_kind(const Procedural& by, const std::vector<GeometryName>& names, MarramOutputKind wanted,
                std::span<const std::unique_ptr<Procedural>> procedurals) {
    for (const GeometryName& name : names)
        for (const auto& other : procedurals)
            if (other->kind() != wanted && other->name() == name.name)
                throw InputError(name.place,
                                 by.name() + ": '" + name.name + "' makes no " +
                                     (wanted == MARRAM_MESH ? "mesh" : "curves"),
                                 "name another");
}

} // namespace

std::vector<size_t> order_of(std::span<const std::unique_ptr<Procedural>> procedurals) {
    for (const auto& procedural : procedurals) {
        check_kind(*procedural, procedural->meshes(), MARRAM_MESH, procedurals);
        check_kind(*procedural, procedural->curves(), MARRAM_CURVES, procedurals);
    }
    return Sort(procedurals).order();
}

void update_procedurals(std::span<const std::unique_ptr<Procedural>> procedurals, std::span<const Item> items,
                        const ParamSet& wind, GeometryChanges& changes) {
    // The graph depends on the new values.
    for (size_t i = 0; i < procedurals.size(); ++i) {
        const uint32_t before = procedurals[i]->roles;
        procedurals[i]->read_dependencies(items[i], wind);
        if (procedurals[i]->roles != before) changes[procedurals[i]->name()] |= MARRAM_EVERYTHING;
    }
    // Every dependent remembers the changes first, so that they survive if a procedural throws.
    const auto propagate = [&](const std::string& name, uint32_t change) {
        const auto made = std::ranges::find(procedurals, name, [](const auto& p) { return p->name(); });
        for (const auto& procedural : procedurals) {
            const bool traced = procedural->kind() == MARRAM_CURVES && procedural->name() != name &&
                                (made == procedurals.end() || (*made)->kind() == MARRAM_MESH);
            if (traced || procedural->names(name)) procedural->pending_inputs |= change;
        }
    };
    for (const auto& [name, change] : changes) propagate(name, change);
    for (const size_t i : order_of(procedurals)) {
        Procedural& procedural = *procedurals[i];
        const uint32_t change = procedural.update(items[i], wind, procedural.pending_inputs);
        procedural.pending_inputs = MARRAM_NOTHING;
        changes[procedural.name()] |= change;
        propagate(procedural.name(), change);
    }
}

} // namespace marram
