// SPDX-License-Identifier: Apache-2.0
#include "core/image/image.h"
#include "core/image/sheet.h"

#include <filesystem>
#include <set>

namespace marram {

namespace {

namespace fs = std::filesystem;

// The last run of digits of a name, "" for none.
std::string last_number(const std::string& name) {
    const size_t last = name.find_last_of("0123456789");
    if (last == std::string::npos) return "";
    const size_t before = name.find_last_not_of("0123456789", last);
    return name.substr(before == std::string::npos ? 0 : before + 1, last - before);
}

bool all_differ(const std::vector<std::string>& texts) {
    return std::set<std::string>(texts.begin(), texts.end()).size() == texts.size();
}

} // namespace

std::vector<std::string> name_captions(const std::vector<std::string>& files) {
    std::vector<std::string> stems, names;
    for (const std::string& file : files) {
        stems.push_back(fs::path(file).stem().string());
        names.push_back(fs::path(file).filename().string());
    }
    return all_differ(stems) ? stems : all_differ(names) ? names : files;
}

std::vector<std::string> frame_captions(const std::vector<std::string>& files) {
    std::vector<std::string> captions;
    for (const std::string& file : files) {
        const std::string stem = fs::path(file).stem().string(), number = last_number(stem);
        captions.push_back(read_metadata(file, "marram:frame").value_or(number.empty() ? stem : number));
    }
    return captions;
}

std::vector<std::string> sheet_captions(const std::vector<std::string>& files) {
    std::set<std::string> scenes, frames;
    for (const std::string& file : files) {
        const auto scene = read_metadata(file, "marram:scene"), frame = read_metadata(file, "marram:frame");
        if (!scene || !frame) return name_captions(files);
        scenes.insert(*scene);
        frames.insert(*frame);
    }
    return scenes.size() == 1 && frames.size() == files.size() && files.size() > 1 ? frame_captions(files)
                                                                                   : name_captions(files);
}

} // namespace marram
