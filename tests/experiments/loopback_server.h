// A server of HTTP on this machine's loopback that answers well or badly.
#pragma once

#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <atomic>
#include <functional>
#include <string>
#include <thread>

namespace palpate::experiments {

/// Answers one request after the other until it is destroyed.
class LoopbackServer {
 public:
  /// Sends to its client; false where the client went away or the server ends.
  class Client {
   public:
    Client(int fd, const std::atomic<bool>& ending) : fd_(fd), ending_(ending) {}
    bool send(const std::string& text) const {
      std::size_t done = 0;
      while (done < text.size() && !ending_) {
        pollfd ready{fd_, POLLOUT, 0};
        if (::poll(&ready, 1, kTickMs) <= 0) continue;
        const ssize_t sent = ::send(fd_, text.data() + done, text.size() - done, MSG_NOSIGNAL | MSG_DONTWAIT);
        if (sent < 0) return false;
        done += static_cast<std::size_t>(sent);
      }
      return !ending_;
    }
    /// Until the client hangs up.
    void wait() const {
      while (!ending_) {
        pollfd gone{fd_, POLLIN, 0};
        char byte = 0;
        if (::poll(&gone, 1, kTickMs) > 0 && ::recv(fd_, &byte, 1, MSG_DONTWAIT) <= 0) return;
      }
    }

   private:
    int fd_;
    const std::atomic<bool>& ending_;
  };
  /// `request` is all of its header. What is not answered is closed.
  using Answer = std::function<void(const std::string& request, const Client& client)>;

  explicit LoopbackServer(Answer answer)
      : answer_(std::move(answer)), fd_(::socket(AF_INET, SOCK_STREAM, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t size = sizeof address;
    EXPECT_EQ(::bind(fd_, reinterpret_cast<const sockaddr*>(&address), size), 0);
    EXPECT_EQ(::getsockname(fd_, reinterpret_cast<sockaddr*>(&address), &size), 0);
    EXPECT_EQ(::listen(fd_, 4), 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { serve(); });
  }
  LoopbackServer(const LoopbackServer&) = delete;
  LoopbackServer& operator=(const LoopbackServer&) = delete;
  ~LoopbackServer() {
    ending_ = true;
    thread_.join();
    ::close(fd_);
  }
  [[nodiscard]] std::string address(const std::string& file) const {
    return "http://127.0.0.1:" + std::to_string(port_) + "/" + file;
  }

 private:
  static constexpr int kTickMs = 20;

  void serve() {
    while (!ending_) {
      pollfd waiting{fd_, POLLIN, 0};
      if (::poll(&waiting, 1, kTickMs) <= 0) continue;
      const int client = ::accept(fd_, nullptr, nullptr);
      if (client < 0) continue;
      std::string request;
      while (!ending_ && request.find("\r\n\r\n") == std::string::npos) {
        char piece[1024];
        pollfd ready{client, POLLIN, 0};
        if (::poll(&ready, 1, kTickMs) <= 0) continue;
        const ssize_t got = ::recv(client, piece, sizeof piece, 0);
        if (got <= 0) break;
        request.append(piece, static_cast<std::size_t>(got));
      }
      answer_(request, Client(client, ending_));
      ::close(client);
    }
  }

  Answer answer_;
  int fd_;
  std::uint16_t port_ = 0;
  std::atomic<bool> ending_{false};
  std::thread thread_;
};

}  // namespace palpate::experiments
