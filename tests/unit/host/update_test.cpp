// SPDX-License-Identifier: Apache-2.0
// update() of strands with any one value changed gives the bits of a new instance with that value: nothing that was kept
// is old.
#include "tested_procedural.h"

#include "core/scene/suggest.h"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>

namespace marram::testing {
namespace {

// Another value than the default, as in a scene file; "": none is made for this type.
std::string another_value(const MarramParam& param) {
    const std::string initial = param.initial;
    const double low = std::max(param.minimum, -1e3), high = std::min(param.maximum, 1e3);
    const bool there = !initial.empty() && initial != "none";
    switch (param.type) {
    case MARRAM_BOOLEAN:
        return initial == "true" ? "false" : "true";
    case MARRAM_INTEGER:
        return fmt::format("{}", std::clamp(there ? std::stod(initial) + 1.0 : 3.0, low, high));
    case MARRAM_NUMBER:
        return fmt::format("{}", std::clamp(there ? 1.3 * std::stod(initial) + 0.1 : 0.4, low, high));
    case MARRAM_VEC3:
        return "[0.3, 0.9, 0.2]";
    case MARRAM_RANGE:
        return "[0.05, 0.2]";
    case MARRAM_RAMP:
        return "[[0, 0.4], [1, 0.9]]";
    case MARRAM_CHOICE: {
        const std::vector<std::string> choices = split(param.choices, '|');
        return choices[initial.find(choices[0]) == std::string::npos ? 0 : 1];
    }
    default:
        return "";
    }
}

TEST(Update, OfAnyValueGivesTheBitsOfANewInstance) {
    auto library = std::make_shared<PluginLibrary>(default_library, Place{});
    LentWorld world;
    for (float& x : world.meshes[0].uvs) x *= 2.5F; // images repeat, or do not
    std::vector<float> pixels(64);
    for (size_t i = 0; i < pixels.size(); ++i) pixels[i] = float(i % 8) / 7.0F;
    MarramGrid image{};
    image.nx = image.ny = 8, image.nz = image.components = 1;
    image.values = pixels.data();
    for (const ProceduralType& type : library->types()) {
        const std::string name = type.calls.name;
        if (name != "groom" && name != "strands") continue;
        const auto make = [&](const Settings& settings) {
            auto called = std::make_unique<TestedProcedural>(type, world, settings);
            if (name == "groom") {
                EXPECT_EQ(marram_set_grid(called->values.get(), "density_mask", &image, nullptr, "m.png"),
                          MARRAM_OK);
                called->good = marram_values_finish(called->values.get(), &called->host);
                if (!called->good) throw std::runtime_error(called->messages.last);
            }
            return called;
        };
        size_t compared = 0, changed_bits = 0;
        for (const MarramParam& param : type.params) {
            std::string given = param.name, value = another_value(param);
            if (const size_t list = given.find("[]"); list != std::string::npos) given.insert(list + 1, "0");
            if (value.empty() || given.find("[]") != std::string::npos) continue;
            Settings settings = settings_of(name);
            std::erase_if(settings, [&](const auto& setting) { return given == setting.first; });
            settings.emplace_back(given.c_str(), value.c_str());
            std::unique_ptr<TestedProcedural> fresh;
            try {
                fresh = make(settings);
            } catch (const std::runtime_error&) {
                continue; // it needs others, or excludes them
            }
            if (fresh->calls.create(&fresh->host, fresh->good, &fresh->instance) != MARRAM_OK) continue;
            if (fresh->begin(world.frame()) != MARRAM_OK) continue;
            const std::string expected = fresh->evaluate();
            const auto old = make(settings_of(name));
            old->create();
            const std::string before = old->evaluate();
            const MarramUpdate update{sizeof(MarramUpdate), fresh->good, MARRAM_NOTHING};
            uint32_t changed = 0;
            old->expect_ok(old->calls.update(old->instance, &update, &changed));
            EXPECT_TRUE(old->evaluate() == expected) << name << ": " << given << " = " << value;
            ++compared;
            changed_bits += expected != before;
        }
        std::printf("%s: %zu values updated, %zu of them changed the output\n", name.c_str(), compared,
                    changed_bits);
        EXPECT_GT(changed_bits, 20u) << name;
    }
}

} // namespace
} // namespace marram::testing
