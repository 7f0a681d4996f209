// Internal to the bridge: when the newest datagrams were sent, so that what answers one of them has an age.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>

namespace palpate::device {

/// A ring over the sequence numbers. 1024 of them are 128 ms at 8 kHz: far beyond any age that passes.
class SentTimes {
 public:
  void note(std::uint32_t sequence, std::int64_t now_ns) noexcept {
    slots_[sequence % kSlots] = {sequence, now_ns, true};
  }
  /// Nothing for what was never sent, or too long ago to be held.
  [[nodiscard]] std::optional<std::int64_t> age_ns(std::uint32_t sequence,
                                                   std::int64_t now_ns) const noexcept {
    const Slot& slot = slots_[sequence % kSlots];
    if (!slot.used || slot.sequence != sequence) return std::nullopt;
    return now_ns - slot.at_ns;
  }

 private:
  static constexpr std::size_t kSlots = 1024;
  struct Slot {
    std::uint32_t sequence = 0;
    std::int64_t at_ns = 0;
    bool used = false;
  };
  std::array<Slot, kSlots> slots_{};
};

}  // namespace palpate::device
