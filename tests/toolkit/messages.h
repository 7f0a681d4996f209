// What a message or an error must say, and values that must be there.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <initializer_list>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include <palpate/result.h>

namespace palpate::test {

/// Whether `text` has each of `parts` in it.
template <class... Parts>
testing::AssertionResult contains(std::string_view text, const Parts&... parts) {
  for (const std::string_view part : {std::string_view(parts)...})
    if (text.find(part) == std::string_view::npos)
      return testing::AssertionFailure() << "no \"" << part << "\" in \"" << text << "\"";
  return testing::AssertionSuccess() << "all of it in \"" << text << "\"";
}

/// Whether one of `texts` has `part` in it.
inline bool any_says(const std::vector<std::string>& texts, std::string_view part) {
  return std::any_of(texts.begin(), texts.end(),
                     [&](const std::string& text) { return text.find(part) != std::string::npos; });
}

/// Whether `result` is an error whose message has each of `parts` in it.
template <class R, class... Parts>
testing::AssertionResult refused(const R& result, const Parts&... parts) {
  if (result) return testing::AssertionFailure() << "accepted";
  if constexpr (sizeof...(parts) > 0) return contains(result.error().message(), parts...);
  return testing::AssertionSuccess();
}

/// What is in `result`; an error ends the test with its message.
template <class T>
T value_of(Result<T> result) {
  if (!result) throw std::runtime_error(result.error().message());
  return *std::move(result);
}

// Files cut short and files with changed bytes.

/// Gives `read` each beginning of `whole` that is shorter than `end`.
template <class Bytes, class Read>
void each_cut(const Bytes& whole, std::size_t end, Read&& read) {
  for (std::size_t length = 0; length < end; ++length) {
    SCOPED_TRACE(testing::Message() << "cut at byte " << length);
    read(Bytes(whole.begin(), whole.begin() + static_cast<std::ptrdiff_t>(length)));
  }
}

/// Gives `read` a copy of `whole` for each byte and each mask, with that byte changed by it.
template <class Bytes, class Read>
void each_flip(const Bytes& whole, std::initializer_list<int> masks, Read&& read) {
  for (std::size_t at = 0; at < whole.size(); ++at)
    for (const int mask : masks) {
      SCOPED_TRACE(testing::Message() << "byte " << at << " changed by " << mask);
      Bytes changed = whole;
      changed[at] = static_cast<typename Bytes::value_type>(static_cast<int>(changed[at]) ^ mask);
      read(changed);
    }
}

}  // namespace palpate::test
