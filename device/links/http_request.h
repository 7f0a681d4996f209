// One request over HTTP to a service on this machine or network: settings of a device, asked for before a
// session. Not for the frame.
#pragma once

#include <cstdint>
#include <string>

#include "toolkit/core/result.h"

namespace palpate::device {

struct HttpRequest {
  std::string host = "127.0.0.1";
  std::uint16_t port = 0;
  std::string method = "GET", path = "/";
  std::string body;  ///< JSON; empty: none
};

struct HttpAnswer {
  int status = 0;
  std::string body;  ///< at most 64 KB of it
};

/// Waits 2 s at most. An Error where nobody answers, or what answers is no HTTP.
[[nodiscard]] Result<HttpAnswer> http_request(const HttpRequest& request);

/// Status and body of a whole answer. The body is what the length says, where it says one, else the rest;
/// chunks are put together. An Error for what is no HTTP.
[[nodiscard]] Result<HttpAnswer> parsed_http_answer(const std::string& text);

}  // namespace palpate::device
