// SPDX-License-Identifier: Apache-2.0
#include "core/cli/commands.h"
#include "core/cli/exit_codes.h"
#include "core/cli/interrupt.h"
#include "core/cli/output.h"
#include "core/view/live_view.h"

#include <tbb/global_control.h>

#include <array>
#include <chrono>
#include <cstdlib>
#include <thread>

#include <spawn.h>
#include <sys/wait.h>

namespace marram {
namespace {

bool has_screen() { return std::getenv("DISPLAY") || std::getenv("WAYLAND_DISPLAY"); }

// By the desktop's own command; without one the address is printed alone.
void open_in_browser(std::string address) {
    std::string command = "xdg-open";
    const std::array<char*, 3> arguments = {command.data(), address.data(), nullptr};
    pid_t child = 0;
    if (::posix_spawnp(&child, command.c_str(), nullptr, nullptr, arguments.data(), environ) != 0) return;
    std::thread([child] { ::waitpid(child, nullptr, 0); }).detach();
}

std::string quoted_for_shell(const std::string& text) {
    std::string quoted = "'";
    for (const char c : text) quoted += c == '\'' ? std::string("'\\''") : std::string(1, c);
    return quoted + "'";
}

} // namespace

int view_command(const ViewOptions& options) {
    const int threads = threads_of(options);
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, size_t(threads));
    LiveView view(
        {options.scene, options.overrides, options.port, threads, [&] { return memory_of(options); }});
    print_result("{}\n", view.address());
    flush_results();
    if (!options.quiet)
        print_message("The view is open until Ctrl-C. Anyone who knows the address can use it.\n");
    if (options.opens && has_screen()) open_in_browser(view.address());
    const ExitBlocker until_it_ends; // a save is not broken off
    const std::jthread watch([&](const std::stop_token& ended) {
        while (!interrupted() && !ended.stop_requested())
            std::this_thread::sleep_for(std::chrono::milliseconds(20));
        view.end();
    });
    view.run();
    std::string unsaved;
    for (const auto& [key, value] : view.unsaved())
        unsaved += " --set " + quoted_for_shell(key + "=" + value);
    if (!unsaved.empty() && !options.quiet)
        print_message("{}: these changes are not saved:{}\n", options.scene, unsaved);
    return exit_done;
}

} // namespace marram
