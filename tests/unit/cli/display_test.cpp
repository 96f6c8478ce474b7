// SPDX-License-Identifier: Apache-2.0
// --display, against viewers of our own: one that reads all, one that goes away, one that never reads.
#include "core/image/display.h"
#include "program.h"

#include <cmath>
#include <functional>
#include <future>
#include <thread>

#include <arpa/inet.h>
#include <netinet/in.h>
#include <sys/socket.h>

namespace marram::testing {
namespace {

// Listens on the loopback interface, and serves one connection on a thread.
class Viewer {
  public:
    explicit Viewer(std::function<void(int connection)> serve)
        : listener_(::socket(AF_INET, SOCK_STREAM, 0)) {
        const int small = 4096; // so that the picture does not fit into the buffers of the sockets
        ::setsockopt(listener_, SOL_SOCKET, SO_RCVBUF, &small, sizeof small);
        sockaddr_in address{};
        address.sin_family = AF_INET;
        address.sin_addr.s_addr = ::htonl(INADDR_LOOPBACK);
        EXPECT_EQ(::bind(listener_, reinterpret_cast<sockaddr*>(&address), sizeof address), 0);
        socklen_t size = sizeof address;
        ::getsockname(listener_, reinterpret_cast<sockaddr*>(&address), &size);
        port_ = ::ntohs(address.sin_port);
        EXPECT_EQ(::listen(listener_, 1), 0);
        thread_ = std::thread([this, serve = std::move(serve)] {
            const int connection = ::accept(listener_, nullptr, nullptr);
            if (connection < 0) return;
            connected_ = true;
            serve(connection);
            ::close(connection);
        });
    }
    ~Viewer() { end(); }
    Viewer(const Viewer&) = delete;
    Viewer& operator=(const Viewer&) = delete;

    // True if somebody has connected.
    bool end() {
        if (thread_.joinable()) {
            ::shutdown(listener_, SHUT_RDWR);
            thread_.join();
            ::close(listener_);
        }
        return connected_;
    }
    std::string address() const { return fmt::format("127.0.0.1:{}", port_); }

  private:
    int listener_, port_ = 0;
    bool connected_ = false;
    std::thread thread_;
};

// Reads a packet strictly.
class PacketReader {
  public:
    explicit PacketReader(std::string bytes) : bytes_(std::move(bytes)) {}
    template <typename T>
    T number() {
        T value{};
        if (at_ + sizeof value > bytes_.size()) throw std::runtime_error("the packet is too short");
        std::memcpy(&value, bytes_.data() + at_, sizeof value);
        at_ += sizeof value;
        return value;
    }
    std::string text() {
        const size_t end = bytes_.find('\0', at_);
        if (end == std::string::npos) throw std::runtime_error("a text has no end");
        const std::string value = bytes_.substr(at_, end - at_);
        at_ = end + 1;
        return value;
    }
    std::vector<std::string> texts(int count) {
        std::vector<std::string> all;
        for (int i = 0; i < count; ++i) all.push_back(text());
        return all;
    }
    size_t left() const { return bytes_.size() - at_; }

  private:
    std::string bytes_;
    size_t at_ = 0;
};

// What a viewer knows of the images, and how often it was told.
struct Shown {
    int created = 0, updated = 0; // updated: all rows
    std::string name;
    int width = 0, height = 0, next_row = 0;
    std::vector<std::string> channels;
    std::vector<float> pixels; // interleaved

    void take(PacketReader packet) {
        const int operation = packet.number<uint8_t>(), selects = packet.number<uint8_t>();
        const std::string image = packet.text();
        if (operation == 4) {
            EXPECT_EQ(selects, 1);
            EXPECT_EQ(next_row, 0) << "in the middle of an update";
            ++created;
            name = image;
            width = packet.number<int32_t>(), height = packet.number<int32_t>();
            channels = packet.texts(packet.number<int32_t>());
            pixels.assign(size_t(width) * size_t(height) * channels.size(), 0.0F);
        } else {
            ASSERT_EQ(operation, 6);
            EXPECT_EQ(selects, 0) << "the user may look at another";
            EXPECT_EQ(image, name);
            const int count = packet.number<int32_t>();
            ASSERT_EQ(packet.texts(count), channels);
            ASSERT_EQ(packet.number<int32_t>(), 0);
            ASSERT_EQ(packet.number<int32_t>(), next_row);
            ASSERT_EQ(packet.number<int32_t>(), width);
            const int rows = packet.number<int32_t>();
            ASSERT_TRUE(rows > 0 && next_row + rows <= height);
            for (int c = 0; c < count; ++c) ASSERT_EQ(packet.number<int64_t>(), c);
            for (int c = 0; c < count; ++c) ASSERT_EQ(packet.number<int64_t>(), count);
            const size_t values = size_t(width) * size_t(rows) * size_t(count);
            ASSERT_EQ(packet.left(), values * sizeof(float));
            for (size_t i = 0; i < values; ++i)
                pixels[size_t(next_row) * size_t(width) * size_t(count) + i] = packet.number<float>();
            next_row += rows;
            if (next_row == height) ++updated, next_row = 0;
        }
        EXPECT_EQ(packet.left(), 0u);
    }
};

// Takes the whole packets from the stream.
void take_packets(std::string& stream, Shown& shown) {
    size_t at = 0;
    for (uint32_t size = 0; stream.size() - at >= sizeof size; at += size) {
        std::memcpy(&size, stream.data() + at, sizeof size);
        if (size < 6) throw std::runtime_error("a packet has a wrong length");
        if (size > stream.size() - at) break;
        shown.take(PacketReader(stream.substr(at + sizeof size, size - sizeof size)));
    }
    stream.erase(0, at);
}

// All packets of a connection, to its end.
Shown shown_by(std::string stream) {
    Shown shown;
    take_packets(stream, shown);
    EXPECT_EQ(stream.size(), 0u) << "the last packet is whole";
    EXPECT_EQ(shown.next_row, 0) << "the last update is whole";
    return shown;
}

void read_all(int connection, std::string& stream) {
    std::vector<char> buffer(1 << 16);
    for (ssize_t count = 0; (count = ::read(connection, buffer.data(), buffer.size())) > 0;)
        stream.append(buffer.data(), size_t(count));
}

// Half floats round by at most 2^-11 of a value.
void expect_shows(const Shown& shown, const std::string& file) {
    const Image image = read_image(file);
    ASSERT_EQ(shown.width, image.width);
    ASSERT_EQ(shown.height, image.height);
    EXPECT_EQ(std::set<std::string>(shown.channels.begin(), shown.channels.end()),
              std::set<std::string>(image.channel_names.begin(), image.channel_names.end()));
    for (size_t c = 0; c < shown.channels.size(); ++c) {
        const auto same =
            std::find(image.channel_names.begin(), image.channel_names.end(), shown.channels[c]);
        ASSERT_NE(same, image.channel_names.end()) << shown.channels[c];
        const auto other = size_t(same - image.channel_names.begin());
        double worst = 0.0, greatest = 0.0;
        for (size_t i = 0; i < size_t(image.width) * size_t(image.height); ++i) {
            const double a = double(shown.pixels[i * shown.channels.size() + c]),
                         b = double(image.pixels[i * size_t(image.channels) + other]);
            worst = std::max(worst, std::abs(a - b) - std::ldexp(std::abs(a), -11));
            greatest = std::max(greatest, std::abs(a));
        }
        EXPECT_LE(worst, std::ldexp(1.0, -24)) << shown.channels[c];
        EXPECT_GT(greatest, 0.0) << shown.channels[c];
    }
}

SceneText scene_of(const std::string& size, int samples) {
    return {.film = fmt::format("size = [{}]\nsamples = {}\nmax_depth = 3\n", size, samples)};
}

TEST(Display, ShowsThePictureThatIsWritten) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", scene_of("320, 200", 20));
    std::string stream;
    Viewer viewer([&](int connection) { read_all(connection, stream); });
    const std::vector<std::string> render = {"render", scene, "--frame", "1", "--aov", "depth,normal", "-o"};
    auto with = render, without = render;
    with.insert(with.end(), {folder / "a.exr", "--display", viewer.address()});
    without.push_back(folder / "b.exr");
    EXPECT_DONE(marram(with));
    EXPECT_TRUE(viewer.end());
    EXPECT_DONE(marram(without));
    EXPECT_TRUE(same_picture(folder / "a.exr", folder / "b.exr"));
    const Shown shown = shown_by(stream);
    EXPECT_EQ(shown.name, folder / "a.exr");
    EXPECT_EQ(shown.channels,
              (std::vector<std::string>{"R", "G", "B", "A", "depth.Z", "normal.X", "normal.Y", "normal.Z"}));
    EXPECT_EQ(shown.created, 1);
    EXPECT_GE(shown.updated, 1);
    expect_shows(shown, folder / "a.exr");
}

// A picture that takes hours. Ctrl-C does not wait for the viewer.
TEST(Display, ShowsThePictureWhileItRefines) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", scene_of("64, 40", 65536));
    Shown shown;
    std::promise<pid_t> started;
    Viewer viewer([&](int connection) {
        std::string stream;
        std::vector<char> buffer(1 << 16);
        std::vector<std::vector<float>> states;
        const pid_t child = started.get_future().get();
        for (ssize_t count = 0; (count = ::read(connection, buffer.data(), buffer.size())) > 0;) {
            stream.append(buffer.data(), size_t(count));
            const int before = shown.updated;
            take_packets(stream, shown);
            if (shown.updated > before) states.push_back(shown.pixels);
            if (states.size() == 3 && shown.updated > before) ::kill(child, SIGINT);
        }
        ASSERT_GE(states.size(), 3u);
        EXPECT_NE(states[0], states[1]);
        EXPECT_NE(states[1], states[2]);
    });
    load_image_library(); // once, or each child would load it again
    const std::string address = viewer.address();
    const pid_t child = ::fork();
    if (child == 0) {
        ::dup2(::open("/dev/null", O_WRONLY), STDOUT_FILENO);
        run_program(
            {"render", scene, "--frame", "1", "--quiet", "-o", folder / "a.exr", "--display", address});
    }
    ASSERT_GT(child, 0);
    started.set_value(child);
    int status = 0;
    ::waitpid(child, &status, 0);
    EXPECT_EQ(exit_code(status), 130);
    EXPECT_TRUE(viewer.end());
    EXPECT_EQ(folder.names(), (std::set<std::string>{"a.exr.state.tif", "a.partial.exr", "a.toml"}));
}

TEST(Display, ShowsFramesInOneImage) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", scene_of("24, 16", 2));
    std::string stream;
    Viewer viewer([&](int connection) { read_all(connection, stream); });
    EXPECT_DONE(marram(
        {"render", scene, "--frames", "1-3", "-o", folder / "f.#.exr", "--display", viewer.address()}));
    EXPECT_TRUE(viewer.end());
    const Shown shown = shown_by(stream);
    EXPECT_EQ(shown.name, folder / "f.#.exr");
    EXPECT_EQ(shown.created, 1);
    expect_shows(shown, folder / "f.3.exr");
}

// The picture is as without a viewer, and there is one line. Returns it.
std::string fault_of(const std::string& address) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", scene_of("1024, 640", 1));
    const ProgramResult done =
        marram({"render", scene, "--frames", "1-2", "-o", folder / "a.#.exr", "--display", address});
    EXPECT_EQ(done.code, 0);
    EXPECT_EQ(done.out, folder / "a.1.exr" + "\n" + (folder / "a.2.exr") + "\n");
    EXPECT_EQ(lines(done.err).size(), 1u) << done.err;
    EXPECT_DONE(marram({"render", scene, "--frames", "1-2", "-o", folder / "b.#.exr"}));
    for (const char* frame : {"1", "2"})
        EXPECT_TRUE(same_picture(folder / (std::string("a.") + frame + ".exr"),
                                 folder / (std::string("b.") + frame + ".exr")));
    return done.err;
}

TEST(Display, MayGoAway) {
    Viewer viewer([](int connection) {
        char some[1000];
        EXPECT_GT(::read(connection, some, sizeof some), 0);
    });
    EXPECT_EQ(fault_of(viewer.address()),
              "--display " + viewer.address() +
                  ": the viewer is gone: the render goes on without; start the viewer first\n");
    EXPECT_TRUE(viewer.end());
}

TEST(Display, MayNeverRead) {
    int ends[2] = {-1, -1};
    ASSERT_EQ(::pipe(ends), 0);
    Viewer viewer([&](int) { // until the program has ended
        char byte = 0;
        EXPECT_EQ(::read(ends[0], &byte, 1), 1);
    });
    EXPECT_EQ(
        fault_of(viewer.address()),
        "--display " + viewer.address() +
            ": the viewer does not take the picture: the render goes on without; start the viewer first\n");
    EXPECT_EQ(::write(ends[1], "", 1), 1);
    EXPECT_TRUE(viewer.end());
    ::close(ends[0]), ::close(ends[1]);
}

TEST(Display, MayNotBeThere) {
    Viewer viewer([](int) {});
    EXPECT_FALSE(viewer.end());
    const std::string fault = fault_of(viewer.address());
    EXPECT_TRUE(fault.starts_with("--display " + viewer.address() + ": no viewer answers (")) << fault;
}

TEST(Display, AddressesAreChecked) {
    const Folder folder;
    const std::string scene = folder.write("a.toml", SceneText{});
    for (const auto& [address, what] : std::map<std::string, std::string>{
             {"", "it has no port"},
             {"localhost", "it has no port"},
             {"localhost:", "its port is no number from 1 to 65535"},
             {"localhost:tev", "its port is no number from 1 to 65535"},
             {"localhost:0", "its port is no number from 1 to 65535"},
             {"localhost:65536", "its port is no number from 1 to 65535"},
             {"localhost:14158x", "its port is no number from 1 to 65535"},
             {":14158", "it names no host"},
             {"http://localhost:14158", "it names no host"},
             {"::1:14158", "an address of IPv6 needs brackets, as in [::1]:14158"}}) {
        const ProgramResult done = marram({"render", scene, "-o", folder / "a.png", "--display", address});
        EXPECT_EQ(done.code, 2);
        EXPECT_EQ(done.err, "--display " + address + ": " + what +
                                ": give HOST:PORT, such as 127.0.0.1:14158, where tev listens\n");
        EXPECT_EQ(folder.names(), std::set<std::string>{"a.toml"});
    }
    EXPECT_EQ(parse_display("localhost:14158").host, "localhost");
    EXPECT_EQ(parse_display("[::1]:14158").host, "::1");
    EXPECT_EQ(parse_display("[::1]:14158").port, "14158");
}

// By hand, from tev's description.
TEST(Display, PacketsAreThoseOfTheProtocol) {
    using namespace std::string_literals;
    const std::vector<std::string> channels = {"R", "z.Y"};
    const std::vector<char> create = create_packet("a.exr", 2, 258, channels);
    EXPECT_EQ(std::string(create.begin(), create.end()), "\x1e\0\0\0\x04\x01"s + "a.exr\0"s + "\x02\0\0\0"s +
                                                             "\x02\x01\0\0"s + "\x02\0\0\0"s + "R\0z.Y\0"s);
    const std::vector<float> pixels = {1.0F, -2.0F};
    const std::vector<char> update = update_packets("a", 1, 1, channels, pixels);
    const std::string zeros = std::string(7, '\0');
    EXPECT_EQ(std::string(update.begin(), update.end()),
              "\x4a\0\0\0\x06\0"s + "a\0"s + "\x02\0\0\0"s + "R\0z.Y\0"s +
                  "\0\0\0\0\0\0\0\0\x01\0\0\0\x01\0\0\0"s + "\0"s + zeros + "\x01"s + zeros + "\x02"s +
                  zeros + "\x02"s + zeros + "\0\0\x80\x3f"s + "\0\0\0\xc0"s);
}

} // namespace
} // namespace marram::testing
