// SPDX-License-Identifier: Apache-2.0
// The server of the live view: HTTP and WebSocket on the loopback interface. Its code, which needs
// Boost.Beast, and the page are in server/, in libmarram_view.so, loaded when a view is opened.
//
// What it serves: the files of the page under http://127.0.0.1:PORT/TOKEN/, and a WebSocket there. Who does
// not know the token gets 404. Requests are refused whose Host is not this machine (a name that was made to
// point here, DNS rebinding), and WebSockets whose Origin is another page. Through an SSH tunnel the port
// of the address may be another one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <string>

namespace marram {

inline constexpr size_t max_view_message = size_t(64) << 10; // bytes that a page may send at once

using ViewClient = uint64_t; // a connected page; numbers are not used twice

// Called by the server's thread. They must return soon and not throw.
struct ViewEvents {
    std::function<void(ViewClient)> joined, left;
    // False: the client sends more than it may, and is disconnected.
    std::function<bool(ViewClient, std::string message)> message;
};

class ViewServer {
  public:
    virtual ~ViewServer() = default; // disconnects all, and ends the thread
    virtual uint16_t port() const = 0;
    // From any thread; messages of a client arrive in order. Nothing happens if it has left.
    virtual void send(ViewClient client, std::shared_ptr<const std::string> bytes, bool binary) = 0;
    virtual size_t unsent_bytes(ViewClient client) const = 0; // given to send(), not yet on the line
};

struct ViewLibrary {
    const char* version;
    size_t size;
    // port 0: any that is free. Throws std::runtime_error with the reason, such as a port that is in use.
    std::unique_ptr<ViewServer> (*start)(uint16_t port, const std::string& token, ViewEvents events);
};

} // namespace marram
