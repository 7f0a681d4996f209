// Keys of the terminal while a session runs.
#pragma once

#include <optional>

#include "toolkit/core/at_stop.h"

namespace palpate::experiments {

/// While it lives the terminal hands over single keys, unseen. Where standard input is no terminal there are
/// none. However the program ends, the terminal is as before.
class Keys {
 public:
  Keys();
  ~Keys();
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;
  /// The next one that was pressed, without waiting.
  [[nodiscard]] std::optional<char> next();
  [[nodiscard]] bool there() const noexcept { return raw_; }

 private:
  void give_back() noexcept;
  bool raw_ = false;
  AtStop at_stop_;
};

}  // namespace palpate::experiments
