#include "device/links/service_link.h"

#include <netdb.h>
#include <poll.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <cerrno>
#include <charconv>
#include <memory>
#include <string_view>

#include <palpate/clock.h>
#include <palpate/result.h>

namespace palpate::device {
namespace {

constexpr double kHttpPatienceMs = 2000.0;
constexpr std::size_t kMaxAnswer = 65'536;

class HttpSocket {
 public:
  explicit HttpSocket(int fd) noexcept : fd_(fd) {}
  HttpSocket(const HttpSocket&) = delete;
  HttpSocket& operator=(const HttpSocket&) = delete;
  ~HttpSocket() {
    if (fd_ >= 0) ::close(fd_);
  }
  [[nodiscard]] int fd() const noexcept { return fd_; }
  /// Waits until the socket is readable or writable; false on timeout.
  [[nodiscard]] bool ready(short events, const Stopwatch& watch) const noexcept {
    pollfd one{fd_, events, 0};
    const double left_ms = kHttpPatienceMs - watch.ms();
    return left_ms > 0.0 && ::poll(&one, 1, static_cast<int>(left_ms) + 1) > 0;
  }

 private:
  int fd_;
};

Error no_http(const HttpRequest& request, const std::string& why) {
  return {"no answer from http://" + request.host + ":" + std::to_string(request.port) + request.path + ": " +
              why,
          "start the maker's service, or name its host and port", "", 0};
}

/// Empty if absent.
std::string_view head_field(std::string_view head, std::string_view name) {
  for (std::size_t at = head.find("\r\n"); at != std::string_view::npos; at = head.find("\r\n", at + 2)) {
    const std::string_view line = head.substr(at + 2, head.find("\r\n", at + 2) - at - 2);
    if (line.size() <= name.size() || line[name.size()] != ':') continue;
    const bool same =
        std::equal(name.begin(), name.end(), line.begin(),
                   [](unsigned char a, unsigned char b) { return std::tolower(a) == std::tolower(b); });
    if (!same) continue;
    std::string_view value = line.substr(name.size() + 1);
    while (!value.empty() && value.front() == ' ') value.remove_prefix(1);
    return value;
  }
  return {};
}

template <class T>
bool read_number_of(std::string_view text, T& value, int base) {
  return std::from_chars(text.data(), text.data() + text.size(), value, base).ec == std::errc();
}

/// Joins the chunks; stops at a malformed one.
std::string joined_chunks(std::string_view body) {
  constexpr int kHexadecimal = 16;
  std::string whole;
  while (true) {
    const std::size_t end = body.find("\r\n");
    std::size_t size = 0;
    if (end == std::string_view::npos || !read_number_of(body.substr(0, end), size, kHexadecimal) ||
        size == 0)
      return whole;
    body.remove_prefix(end + 2);
    whole.append(body.substr(0, size));
    if (body.size() < size || body.size() - size < 2) return whole;
    body.remove_prefix(size + 2);
  }
}

/// Reads until the other side closes or the announced length arrived.
std::string read_answer(const HttpSocket& socket, const Stopwatch& watch) {
  std::string text;
  std::array<char, 4096> piece;
  while (text.size() < kMaxAnswer && socket.ready(POLLIN, watch)) {
    const ssize_t size = ::recv(socket.fd(), piece.data(), piece.size(), 0);
    if (size <= 0) break;
    text.append(piece.data(), static_cast<std::size_t>(size));
    const std::size_t head = text.find("\r\n\r\n");
    std::size_t length = 0;
    if (head != std::string::npos &&
        read_number_of(head_field(std::string_view(text).substr(0, head), "content-length"), length, 10) &&
        text.size() >= head + 4 + length)
      break;
  }
  return text;
}

}  // namespace

Result<HttpAnswer> parsed_http_answer(const std::string& text) {
  constexpr std::string_view kBegins = "HTTP/1.";
  constexpr std::size_t kStatusAt = 9, kStatusDigits = 3;
  const std::size_t head = text.find("\r\n\r\n");
  HttpAnswer answer;
  if (!text.starts_with(kBegins) || head == std::string::npos || head < kStatusAt + kStatusDigits ||
      !read_number_of(std::string_view(text).substr(kStatusAt, kStatusDigits), answer.status, 10))
    return Error{"what answers there speaks no HTTP", "name the service's host and port"};
  const std::string_view fields = std::string_view(text).substr(0, head);
  const std::string_view body = std::string_view(text).substr(head + 4);
  std::size_t length = 0;
  if (head_field(fields, "transfer-encoding").find("chunked") != std::string_view::npos)
    answer.body = joined_chunks(body);
  else if (read_number_of(head_field(fields, "content-length"), length, 10))
    answer.body = body.substr(0, length);
  else
    answer.body = body;
  return answer;
}

Result<HttpAnswer> http_request(const HttpRequest& request) {
  addrinfo wanted{};
  wanted.ai_socktype = SOCK_STREAM;
  addrinfo* list = nullptr;
  const int wrong = ::getaddrinfo(request.host.c_str(), std::to_string(request.port).c_str(), &wanted, &list);
  if (wrong != 0) return no_http(request, ::gai_strerror(wrong));
  const std::unique_ptr<addrinfo, decltype(&::freeaddrinfo)> addresses(list, &::freeaddrinfo);
  const HttpSocket socket(::socket(list->ai_family, SOCK_STREAM | SOCK_NONBLOCK | SOCK_CLOEXEC, 0));
  const Stopwatch watch;
  if (::connect(socket.fd(), list->ai_addr, list->ai_addrlen) != 0 && errno != EINPROGRESS)
    return no_http(request, "refused");
  int failed = 0;
  socklen_t size = sizeof failed;
  if (!socket.ready(POLLOUT, watch) || ::getsockopt(socket.fd(), SOL_SOCKET, SO_ERROR, &failed, &size) != 0 ||
      failed != 0)
    return no_http(request, "refused");
  std::string text = request.method + " " + request.path + " HTTP/1.1\r\nHost: " + request.host + ":" +
                     std::to_string(request.port) + "\r\nConnection: close\r\nAccept: application/json\r\n";
  if (!request.body.empty()) text += "Content-Type: application/json\r\n";
  text += "Content-Length: " + std::to_string(request.body.size()) + "\r\n\r\n" + request.body;
  for (std::size_t sent = 0; sent < text.size();) {
    if (!socket.ready(POLLOUT, watch)) return no_http(request, "it takes nothing");
    const ssize_t some = ::send(socket.fd(), text.data() + sent, text.size() - sent, MSG_NOSIGNAL);
    if (some < 0) return no_http(request, "it hung up");
    sent += static_cast<std::size_t>(some);
  }
  const std::string answer = read_answer(socket, watch);
  if (answer.empty()) return no_http(request, "nothing in 2 s");
  return parsed_http_answer(answer);
}

}  // namespace palpate::device
