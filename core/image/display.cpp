// SPDX-License-Identifier: Apache-2.0
#include "core/image/display.h"

#include "core/math/clock.h"
#include "core/math/problem.h"

#include <algorithm>
#include <bit>
#include <cerrno>
#include <charconv>
#include <chrono>
#include <condition_variable>
#include <cstring>
#include <mutex>
#include <utility>

#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

namespace marram {
namespace {

static_assert(std::endian::native == std::endian::little, "packets are little-endian");

constexpr char create_image = 4, update_image = 6;
constexpr size_t band_bytes = size_t(1) << 20; // of the values of an update
constexpr double connect_seconds = 3.0;
constexpr double patience = 2.0; // s in which the viewer takes nothing
constexpr auto between_looks_at_end = std::chrono::milliseconds(50);

// Appends a packet; complete() sets its length.
class Packet {
  public:
    Packet(std::vector<char>& out, char operation, bool selects, const std::string& name)
        : out_(out), begin_(out.size()) {
        number(uint32_t(0));
        number(operation);
        number(char(selects));
        text(name);
    }
    template <typename T>
    void number(T value) {
        bytes(&value, sizeof value);
    }
    void text(const std::string& value) { bytes(value.c_str(), value.size() + 1); }
    void texts(std::span<const std::string> all) {
        for (const std::string& value : all) text(value);
    }
    void values(std::span<const float> all) { bytes(all.data(), all.size_bytes()); }
    void complete() {
        const auto size = uint32_t(out_.size() - begin_);
        std::memcpy(out_.data() + begin_, &size, sizeof size);
    }

  private:
    void bytes(const void* data, size_t size) {
        const auto* const first = static_cast<const char*>(data);
        out_.insert(out_.end(), first, first + size);
    }
    std::vector<char>& out_;
    size_t begin_;
};

// A file descriptor that is closed at the end.
class Descriptor {
  public:
    explicit Descriptor(int number = -1) : number_(number) {}
    ~Descriptor() {
        if (number_ >= 0) ::close(number_);
    }
    Descriptor(Descriptor&& other) noexcept : number_(std::exchange(other.number_, -1)) {}
    Descriptor& operator=(Descriptor&& other) noexcept {
        std::swap(number_, other.number_);
        return *this;
    }
    int number() const { return number_; }

  private:
    int number_;
};

[[noreturn]] void refuse(const std::string& text, const std::string& what) {
    throw InputError({"--display " + text}, what,
                     "give HOST:PORT, such as 127.0.0.1:14158, where tev listens");
}

} // namespace

DisplayAddress parse_display(const std::string& text) {
    const size_t colon = text.rfind(':');
    if (colon == std::string::npos) refuse(text, "it has no port");
    DisplayAddress address{text, text.substr(0, colon), text.substr(colon + 1)};
    std::string& host = address.host;
    if (host.empty() || host.find_first_of("/ ") != std::string::npos) refuse(text, "it names no host");
    if (host.size() > 2 && host.front() == '[' && host.back() == ']')
        host = host.substr(1, host.size() - 2);
    else if (host.find(':') != std::string::npos)
        refuse(text, "an address of IPv6 needs brackets, as in [::1]:14158");
    uint32_t port = 0;
    const char* const end = address.port.data() + address.port.size();
    const auto [stop, error] = std::from_chars(address.port.data(), end, port);
    if (error != std::errc{} || stop != end || port < 1 || port > 65535)
        refuse(text, "its port is no number from 1 to 65535");
    return address;
}

std::vector<char> create_packet(const std::string& name, int width, int height,
                                std::span<const std::string> channels) {
    std::vector<char> bytes;
    Packet packet(bytes, create_image, true, name);
    for (const int32_t number : {width, height, int(channels.size())}) packet.number(number);
    packet.texts(channels);
    packet.complete();
    return bytes;
}

std::vector<char> update_packets(const std::string& name, int width, int height,
                                 std::span<const std::string> channels, std::span<const float> pixels) {
    const size_t row = size_t(width) * channels.size();
    const int band = int(std::max<size_t>(1, band_bytes / (row * sizeof(float))));
    std::vector<char> bytes;
    bytes.reserve(pixels.size_bytes() + pixels.size_bytes() / 16);
    for (int y = 0; y < height; y += band) {
        const int rows = std::min(band, height - y);
        Packet packet(bytes, update_image, false, name);
        packet.number(int32_t(channels.size()));
        packet.texts(channels);
        for (const int32_t number : {0, y, width, rows}) packet.number(number);
        for (size_t c = 0; c < channels.size(); ++c) packet.number(int64_t(c));
        for (size_t c = 0; c < channels.size(); ++c) packet.number(int64_t(channels.size()));
        packet.values(pixels.subspan(size_t(y) * row, size_t(rows) * row));
        packet.complete();
    }
    return bytes;
}

// Shared with the thread, which may be left behind while it looks up the host's name.
struct Display::Connection {
    explicit Connection(DisplayAddress to) : address(std::move(to)) {}

    const DisplayAddress address;
    std::mutex guard; // of all below
    std::condition_variable changed;
    std::string name; // of the image that create, or an earlier packet, makes
    int width = 0, height = 0;
    std::vector<std::string> channels;
    std::vector<char> create, update; // wait
    bool looks_up = true, connected = false, sends = false, ended = false;
    double last_taken = 0.0; // time when the viewer took a byte
    std::optional<Problem> fault, untold_fault;

    bool is_idle() const { return !sends && create.empty() && update.empty(); }
    void fail(const std::string& what, const std::string& fix = "start the viewer first");
    bool is_ended();
    bool wait_until_writable(int socket, double seconds);
    Descriptor connect();
    bool send_all(int socket, const std::vector<char>& bytes);
    void run();
};

void Display::Connection::fail(const std::string& what, const std::string& fix) {
    const std::lock_guard lock(guard);
    if (fault || ended) return;
    fault =
        Problem{{"--display " + address.text}, what, "the render goes on without; " + fix, "display.lost"};
    untold_fault = fault;
    create = update = {};
    changed.notify_all();
}

bool Display::Connection::is_ended() {
    const std::lock_guard lock(guard);
    return ended || fault;
}

// Also true if the connection is broken, which writing tells.
bool Display::Connection::wait_until_writable(int socket, double seconds) {
    for (const double end = wall_seconds() + seconds; !is_ended() && wall_seconds() < end;) {
        pollfd wanted{socket, POLLOUT, 0};
        if (::poll(&wanted, 1, int(between_looks_at_end.count())) > 0) return true;
    }
    return false;
}

Descriptor Display::Connection::connect() {
    addrinfo hints{}, *found = nullptr;
    hints.ai_socktype = SOCK_STREAM;
    const int unknown = ::getaddrinfo(address.host.c_str(), address.port.c_str(), &hints, &found);
    {
        const std::lock_guard lock(guard);
        looks_up = false;
    }
    if (unknown != 0) {
        fail(std::string("the host is not known (") + ::gai_strerror(unknown) + ")", "check its name");
        return Descriptor();
    }
    const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> all(found, ::freeaddrinfo);
    int error = ETIMEDOUT;
    for (const addrinfo* one = found; one && !is_ended(); one = one->ai_next) {
        Descriptor made(
            ::socket(one->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, one->ai_protocol));
        const int socket = made.number();
        error = socket >= 0 && ::connect(socket, one->ai_addr, one->ai_addrlen) == 0 ? 0 : errno;
        if (socket >= 0 && error == EINPROGRESS) {
            socklen_t size = sizeof error;
            error = ETIMEDOUT;
            if (wait_until_writable(socket, connect_seconds))
                ::getsockopt(socket, SOL_SOCKET, SO_ERROR, &error, &size);
        }
        if (error == 0) return made;
    }
    fail(std::string("no viewer answers (") + std::strerror(error) + ")");
    return Descriptor();
}

bool Display::Connection::send_all(int socket, const std::vector<char>& bytes) {
    char unexpected = 0;
    const bool closed = ::recv(socket, &unexpected, 1, MSG_PEEK | MSG_DONTWAIT) == 0;
    for (size_t sent = 0; sent < bytes.size();) {
        const ssize_t count =
            closed ? -1 : ::send(socket, bytes.data() + sent, bytes.size() - sent, MSG_NOSIGNAL);
        if (count >= 0) {
            sent += size_t(count);
            const std::lock_guard lock(guard);
            last_taken = wall_seconds();
        } else if (!closed && (errno == EAGAIN || errno == EWOULDBLOCK || errno == EINTR)) {
            wait_until_writable(socket, patience);
            if (is_ended()) return false;
        } else {
            fail("the viewer is gone");
            return false;
        }
    }
    return true;
}

void Display::Connection::run() {
    const Descriptor made = connect();
    if (made.number() < 0) return;
    std::unique_lock lock(guard);
    connected = true;
    for (;;) {
        changed.wait(lock, [&] { return ended || fault || !is_idle(); });
        if (ended || fault) return;
        const std::vector<char> first = std::exchange(create, {}), then = std::exchange(update, {});
        sends = true;
        lock.unlock();
        const bool good = send_all(made.number(), first) && send_all(made.number(), then);
        lock.lock();
        sends = false;
        changed.notify_all();
        if (!good) return;
    }
}

Display::Display(const DisplayAddress& address)
    : connection_(std::make_shared<Connection>(address)),
      thread_([connection = connection_] { connection->run(); }) {}

Display::~Display() {
    bool waits_for_name = false;
    {
        const std::lock_guard lock(connection_->guard);
        connection_->ended = true;
        connection_->changed.notify_all();
        waits_for_name = connection_->looks_up;
    }
    if (waits_for_name)
        thread_.detach();
    else
        thread_.join();
}

bool Display::is_ready() const {
    const std::lock_guard lock(connection_->guard);
    return connection_->connected && !connection_->fault && connection_->is_idle();
}

void Display::show(const std::string& name, int width, int height, std::span<const Layer> layers) {
    std::vector<std::string> channels;
    for (const Layer& layer : layers)
        for (const std::string& channel : layer.channels)
            channels.push_back(layer.name.empty() ? channel : layer.name + "." + channel);
    std::vector<float> pixels(size_t(width) * size_t(height) * channels.size());
    size_t first = 0;
    for (const Layer& layer : layers) {
        const size_t count = layer.channels.size();
        for (size_t i = 0; i < size_t(width) * size_t(height); ++i)
            std::copy_n(layer.pixels + i * count, count, pixels.data() + i * channels.size() + first);
        first += count;
    }
    std::vector<char> update = update_packets(name, width, height, channels, pixels);

    Connection& to = *connection_;
    const std::lock_guard lock(to.guard);
    if (to.fault) return;
    if (to.name != name || to.width != width || to.height != height || to.channels != channels) {
        to.create = create_packet(name, width, height, channels);
        to.name = name, to.width = width, to.height = height;
        to.channels = std::move(channels);
    }
    to.update = std::move(update);
    to.changed.notify_all();
}

void Display::finish(const std::atomic<bool>& cancel) {
    Connection& to = *connection_;
    std::unique_lock lock(to.guard);
    const double begin = wall_seconds();
    while (!to.fault && !to.is_idle() && !cancel) {
        if (wall_seconds() - std::max(begin, to.last_taken) > patience) {
            const bool connected = to.connected;
            lock.unlock();
            to.fail(connected ? "the viewer does not take the picture" : "no viewer answers in time");
            return;
        }
        to.changed.wait_for(lock, between_looks_at_end);
    }
}

void Display::give_up(const std::string& why) { connection_->fail(why); }

std::optional<Problem> Display::take_fault() {
    const std::lock_guard lock(connection_->guard);
    return std::exchange(connection_->untold_fault, std::nullopt);
}

} // namespace marram
