// SPDX-License-Identifier: Apache-2.0
// Shows pictures while they are made, in the viewer tev (https://github.com/Tom94/tev) or another that speaks
// its protocol over TCP. Its packets, of little-endian numbers and of texts that end with a zero byte:
//
//   bytes of the packet, these included  u32
//   operation                            u8    4 creates an image, 6 updates one
//   select the image in the viewer       u8    0, 1
//   name of the image                    text
//   of 4: width, height, channels        3 i32, then a text a channel
//   of 6: channels                       i32, then a text a channel
//         x, y, width, height            4 i32, of the part that is updated
//         place of each channel's first value, and the distance to its next, in values    i64 a channel, twice
//         values                         f32, linear
//
// Source: tev's include/tev/Ipc.h and src/Ipc.cpp. The viewer answers nothing.
#pragma once

#include "core/image/image.h"
#include "core/math/problem.h"

#include <atomic>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <thread>
#include <vector>

namespace marram {

struct DisplayAddress {
    std::string text; // as it was given, for messages
    std::string host; // a name, or an address of IPv4 or IPv6
    std::string port; // 1 to 65535
};

// Parses "HOST:PORT" or "[IPV6]:PORT". Throws InputError with the place "--display TEXT".
DisplayAddress parse_display(const std::string& text);

// The packets. `pixels`: all channels interleaved, rows from the top. Updates are bands of rows of about 1
// MiB.
std::vector<char> create_packet(const std::string& name, int width, int height,
                                std::span<const std::string> channels);
std::vector<char> update_packets(const std::string& name, int width, int height,
                                 std::span<const std::string> channels, std::span<const float> pixels);

// The connection to a viewer. A thread connects and sends, so that none of these functions waits for the
// viewer, except finish().
class Display {
  public:
    explicit Display(const DisplayAddress& address);
    ~Display(); // leaves unsent what waits
    Display(const Display&) = delete;
    Display& operator=(const Display&) = delete;

    // Whether an update would be sent now: nothing else waits, and the viewer is there.
    bool is_ready() const;

    // Adds the picture to what waits, and creates the image first if the size or the channels are new. It
    // replaces a picture that waits and of which nothing has been sent.
    void show(const std::string& name, int width, int height, std::span<const Layer> layers);

    // Returns when all is sent, `cancel` is set, or the viewer has taken nothing for 2 s, which is a fault.
    void finish(const std::atomic<bool>& cancel);

    void give_up(const std::string& why); // nothing is shown any more

    // Why nothing is shown any more; nothing: no fault, or taken before.
    std::optional<Problem> take_fault();

  private:
    struct Connection;
    std::shared_ptr<Connection> connection_;
    std::thread thread_;
};

} // namespace marram
