// Files cut short and files with changed bytes.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <initializer_list>

namespace palpate::test {

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
