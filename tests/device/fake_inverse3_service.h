// A service as the Inverse3's maker ships it, as far as its public pages tell, on a port of this machine: a
// WebSocket server that answers commands with states, settings over HTTP, and faults.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "toolkit/core/vec.h"

namespace palpate::device {

class FakeInverse3Service {
 public:
  enum class Mood { kWell, kNoDevice, kGarbage, kSilent, kStalled };

  explicit FakeInverse3Service(Mood mood);
  FakeInverse3Service(const FakeInverse3Service&) = delete;
  FakeInverse3Service& operator=(const FakeInverse3Service&) = delete;
  /// Hangs up on everybody.
  ~FakeInverse3Service();

  [[nodiscard]] std::uint16_t port() const noexcept;
  /// From here on.
  void set_mood(Mood mood) noexcept;
  /// What the device holds now: it never lets go by itself.
  [[nodiscard]] Vec3 held_n() const;
  [[nodiscard]] std::uint64_t commands() const noexcept;
  /// "METHOD path body" of each, in order.
  [[nodiscard]] std::vector<std::string> requests() const;
  /// Gain of the force gate; below 0: never set.
  [[nodiscard]] double gate() const noexcept;

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace palpate::device
