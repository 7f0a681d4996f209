// Terminal keys during a session.
#pragma once

#include <optional>

#include <palpate/stop_callback.h>

namespace palpate::experiments {

/// Switches the terminal to single keys without echo while it lives. Gives no keys if standard input is no
/// terminal. Restores the terminal however the program ends.
class Keys {
 public:
  Keys();
  ~Keys();
  Keys(const Keys&) = delete;
  Keys& operator=(const Keys&) = delete;
  /// The next key pressed, without waiting.
  [[nodiscard]] std::optional<char> next();
  [[nodiscard]] bool there() const noexcept { return raw_; }

 private:
  void give_back() noexcept;
  bool raw_ = false;
  StopCallback stop_callback_;
};

}  // namespace palpate::experiments
