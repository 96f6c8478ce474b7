// SPDX-License-Identifier: Apache-2.0
// One thread runs all connections (Boost.Asio): they only pass bytes on.
#include "core/view/server/page_files.h"
#include "core/view/server_library.h"

#include <boost/asio/ip/tcp.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/http.hpp>
#include <boost/beast/websocket.hpp>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <deque>
#include <map>
#include <mutex>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

namespace marram {
namespace {

namespace asio = boost::asio;
namespace beast = boost::beast;
namespace http = beast::http;
namespace websocket = beast::websocket;
using asio::ip::tcp;
using beast::error_code;

constexpr size_t max_connections = 64;
constexpr size_t max_header = size_t(16) << 10; // bytes
constexpr auto request_time = std::chrono::seconds(15);
constexpr size_t slowest_line = 10'000; // bytes a second

// The same time whatever the token is.
bool same_token(std::string_view a, std::string_view b) {
    if (a.size() != b.size()) return false;
    unsigned different = 0;
    for (size_t i = 0; i < a.size(); ++i) different |= unsigned(a[i] ^ b[i]);
    return different == 0;
}

// "localhost:8080" names this machine, whatever the port.
bool is_this_machine(std::string_view host) {
    const size_t colon = host.rfind(':');
    if (colon != std::string_view::npos &&
        host.find_first_not_of("0123456789", colon + 1) == std::string_view::npos)
        host = host.substr(0, colon);
    return host == "127.0.0.1" || host == "localhost" || host == "[::1]";
}

class Session;

// What connections share.
struct Hub {
    std::string token;
    ViewEvents events;
    mutable std::mutex mutex; // of the members below
    std::map<ViewClient, std::weak_ptr<Session>> clients;
    ViewClient last_client = 0;
    std::atomic<size_t> connections{0};
};

// A connected page. Lives as long as an operation of it is pending.
class Session : public std::enable_shared_from_this<Session> {
  public:
    Session(tcp::socket socket, Hub& hub) : stream_(std::move(socket)), hub_(hub) {}
    ~Session() { leave(); }

    void accept(const http::request<http::empty_body>& request) {
        stream_.set_option(websocket::stream_base::timeout::suggested(beast::role_type::server));
        stream_.read_message_max(max_view_message);
        stream_.auto_fragment(false);
        stream_.async_accept(request, [self = shared_from_this()](error_code error) {
            if (!error) self->join();
        });
    }

    void send(std::shared_ptr<const std::string> bytes, bool binary) {
        unsent_ += bytes->size();
        asio::post(stream_.get_executor(),
                   [self = shared_from_this(), bytes = std::move(bytes), binary]() mutable {
                       self->queue_.emplace_back(std::move(bytes), binary);
                       if (self->queue_.size() == 1) self->write();
                   });
    }

    size_t unsent() const { return unsent_; }

    void close() {
        asio::post(stream_.get_executor(), [self = shared_from_this()] {
            error_code ignored;
            beast::get_lowest_layer(self->stream_).socket().close(ignored);
        });
    }

  private:
    void join() {
        {
            const std::lock_guard lock(hub_.mutex);
            client_ = ++hub_.last_client;
            hub_.clients[client_] = weak_from_this();
        }
        hub_.events.joined(client_);
        read();
    }

    void leave() {
        --hub_.connections;
        if (client_ == 0) return;
        {
            const std::lock_guard lock(hub_.mutex);
            hub_.clients.erase(client_);
        }
        hub_.events.left(client_);
    }

    void read() {
        stream_.async_read(buffer_, [self = shared_from_this()](error_code error, size_t) {
            if (error) return;
            std::string message = beast::buffers_to_string(self->buffer_.data());
            self->buffer_.consume(self->buffer_.size());
            if (!self->stream_.got_text()) message.clear(); // pages send text
            if (self->hub_.events.message(self->client_, std::move(message))) return self->read();
            self->stream_.async_close({websocket::close_code::policy_error, "too many messages"},
                                      [self](error_code) {});
        });
    }

    void write() {
        const auto& [bytes, binary] = queue_.front();
        stream_.binary(binary);
        stream_.async_write(asio::buffer(*bytes), [self = shared_from_this()](error_code error, size_t) {
            self->unsent_ -= self->queue_.front().first->size();
            self->queue_.pop_front();
            if (error) self->queue_.clear();
            if (!self->queue_.empty()) self->write();
        });
    }

    websocket::stream<beast::tcp_stream> stream_;
    Hub& hub_;
    beast::flat_buffer buffer_{max_view_message + max_header};
    std::deque<std::pair<std::shared_ptr<const std::string>, bool>> queue_; // binary: true
    std::atomic<size_t> unsent_{0};
    ViewClient client_ = 0;
};

// A connection before it becomes a session: requests of files.
class Connection : public std::enable_shared_from_this<Connection> {
  public:
    Connection(tcp::socket socket, Hub& hub) : stream_(std::move(socket)), hub_(hub) { ++hub_.connections; }
    ~Connection() {
        if (!handed_over_) --hub_.connections;
    }

    void read() {
        parser_.emplace();
        parser_->header_limit(max_header);
        parser_->body_limit(0); // none is expected
        stream_.expires_after(request_time);
        http::async_read(stream_, buffer_, *parser_, [self = shared_from_this()](error_code error, size_t) {
            if (!error) self->answer();
        });
    }

  private:
    std::string_view header(http::field name) const {
        const auto value = parser_->get()[name];
        return {value.data(), value.size()};
    }

    // The part of the path behind /TOKEN/; none if the token is wrong.
    std::optional<std::string_view> name_asked_for() const {
        const auto target = parser_->get().target();
        std::string_view path(target.data(), target.size());
        path = path.substr(0, path.find('?'));
        const size_t slash = path.find('/', 1);
        if (path.empty() || slash == std::string_view::npos ||
            !same_token(path.substr(1, slash - 1), hub_.token))
            return {};
        return path.substr(slash + 1);
    }

    void answer() {
        const auto& request = parser_->get();
        const std::string_view host = header(http::field::host), origin = header(http::field::origin);
        if (!is_this_machine(host)) return refuse(http::status::forbidden, "this host is not served\n");
        const auto name = name_asked_for();
        if (!name) return refuse(http::status::not_found, "use the address that marram view has printed\n");
        if (websocket::is_upgrade(request)) {
            if (*name != "socket") return refuse(http::status::not_found, "there is no such socket\n");
            if (origin != "http://" + std::string(host))
                return refuse(http::status::forbidden, "other pages may not connect\n");
            stream_.expires_never();
            handed_over_ = true;
            std::make_shared<Session>(stream_.release_socket(), hub_)->accept(parser_->release());
            return;
        }
        if (request.method() != http::verb::get && request.method() != http::verb::head)
            return refuse(http::status::method_not_allowed, "only GET is answered\n");
        const auto files = page_files();
        const auto found = std::ranges::find(files, name->empty() ? "index.html" : *name, &PageFile::name);
        if (found == files.end()) return refuse(http::status::not_found, "there is no such file\n");
        reply(http::status::ok, found->type, found->bytes, request.keep_alive());
    }

    void refuse(http::status status, std::string_view text) { reply(status, "text/plain", text, false); }

    void reply(http::status status, std::string_view type, std::string_view body, bool keep_alive) {
        auto response = std::make_shared<http::response<http::span_body<const char>>>(status, 11);
        response->set(http::field::content_type, beast::string_view(type.data(), type.size()));
        response->set(http::field::cache_control, "no-store");
        response->set("X-Content-Type-Options", "nosniff");
        response->set("Referrer-Policy", "no-referrer");
        response->set("Cross-Origin-Resource-Policy", "same-origin");
        response->set("Content-Security-Policy",
                      "default-src 'self'; img-src 'self' data: blob:; frame-ancestors 'none'");
        response->keep_alive(keep_alive);
        response->body() = {body.data(), body.size()};
        response->prepare_payload();
        stream_.expires_after(request_time + std::chrono::seconds(body.size() / slowest_line));
        const bool head = parser_->get().method() == http::verb::head;
        const auto done = [self = shared_from_this(), response, keep_alive](error_code error, size_t) {
            if (!error && keep_alive) return self->read();
            self->stream_.socket().shutdown(tcp::socket::shutdown_send, error);
        };
        if (!head) return http::async_write(stream_, *response, done);
        auto serializer = std::make_shared<http::response_serializer<http::span_body<const char>>>(*response);
        http::async_write_header(stream_, *serializer,
                                 [done, serializer](error_code error, size_t n) { done(error, n); });
    }

    beast::tcp_stream stream_;
    Hub& hub_;
    beast::flat_buffer buffer_{max_header};
    std::optional<http::request_parser<http::empty_body>> parser_;
    bool handed_over_ = false;
};

class Server final : public ViewServer {
  public:
    Server(uint16_t port, const std::string& token, ViewEvents events)
        : acceptor_(context_, {asio::ip::address_v4::loopback(), port}) {
        hub_.token = token;
        hub_.events = std::move(events);
        listen();
        thread_ = std::thread([this] { context_.run(); });
    }
    ~Server() override {
        context_.stop();
        thread_.join();
    }
    Server(const Server&) = delete;
    Server& operator=(const Server&) = delete;

    uint16_t port() const override { return acceptor_.local_endpoint().port(); }
    void send(ViewClient client, std::shared_ptr<const std::string> bytes, bool binary) override {
        if (const auto session = find(client)) session->send(std::move(bytes), binary);
    }
    size_t unsent_bytes(ViewClient client) const override {
        const auto session = find(client);
        return session ? session->unsent() : 0;
    }

  private:
    std::shared_ptr<Session> find(ViewClient client) const {
        const std::lock_guard lock(hub_.mutex);
        const auto found = hub_.clients.find(client);
        return found == hub_.clients.end() ? nullptr : found->second.lock();
    }

    void listen() {
        acceptor_.async_accept([this](error_code error, tcp::socket socket) {
            if (!error && hub_.connections < max_connections) {
                error_code ignored;
                socket.set_option(tcp::no_delay(true), ignored);
                std::make_shared<Connection>(std::move(socket), hub_)->read();
            }
            if (error != asio::error::operation_aborted) listen();
        });
    }

    Hub hub_; // outlives the connections, which context_ owns
    asio::io_context context_{1};
    tcp::acceptor acceptor_;
    std::thread thread_;
};

std::unique_ptr<ViewServer> start(uint16_t port, const std::string& token, ViewEvents events) {
    try {
        return std::make_unique<Server>(port, token, std::move(events));
    } catch (const boost::system::system_error& error) {
        throw std::runtime_error(error.code().message());
    }
}

} // namespace
} // namespace marram

extern "C" __attribute__((visibility("default"))) const marram::ViewLibrary* marram_view_library() {
    static const marram::ViewLibrary library = {
        .version = MARRAM_VERSION, .size = sizeof(marram::ViewLibrary), .start = marram::start};
    return &library;
}
