// Mailbox for the newest command to a device: many threads put, one takes. An older force not yet sent is
// dropped.
#pragma once

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include <palpate/vec.h>

namespace palpate::device {

struct CommandBytes {
  static constexpr std::size_t kMost = 65;  ///< a HID report of 64 bytes with its id
  std::array<std::uint8_t, kMost> bytes{};
  std::size_t size = 0;
  [[nodiscard]] std::span<const std::uint8_t> span() const noexcept { return {bytes.data(), size}; }
};

/// Lock-free. Any threads may call put(); one at a time may call take().
class NewestCommand {
 public:
  /// True: take() will give it unless a newer one comes first. False: too long, empty, or kSlots - 2 threads
  /// are in put() now. At most kSlots steps.
  bool put(std::span<const std::uint8_t> bytes) noexcept {
    if (bytes.empty() || bytes.size() > CommandBytes::kMost) return false;
    for (int i = 0; i < kSlots; ++i) {
      Slot& slot = slots_[static_cast<std::size_t>(i)];
      if (slot.held.exchange(true, std::memory_order_acquire)) continue;
      std::copy(bytes.begin(), bytes.end(), slot.command.bytes.begin());
      slot.command.size = bytes.size();
      const int before = newest_.exchange(i, std::memory_order_seq_cst);
      if (before >= 0) {
        slots_[static_cast<std::size_t>(before)].held.store(false, std::memory_order_release);
        replaced_.fetch_add(1, std::memory_order_relaxed);
      }
      return true;
    }
    return false;
  }
  /// Takes the newest command, once. False: none since the last call.
  bool take(CommandBytes& into) noexcept {
    const int newest = newest_.exchange(-1, std::memory_order_seq_cst);
    if (newest < 0) return false;
    Slot& slot = slots_[static_cast<std::size_t>(newest)];
    into = slot.command;
    slot.held.store(false, std::memory_order_release);
    return true;
  }
  [[nodiscard]] bool empty() const noexcept { return newest_.load(std::memory_order_seq_cst) < 0; }
  /// Commands replaced before they were taken.
  [[nodiscard]] std::uint64_t replaced() const noexcept { return replaced_.load(std::memory_order_relaxed); }

 private:
  // One slot for the newest, one being read, the rest for writers: servo, watchdog, stop callback, three
  // spare.
  static constexpr int kSlots = 8;
  struct Slot {
    std::atomic<bool> held{false};
    CommandBytes command;
  };
  std::array<Slot, kSlots> slots_{};
  std::atomic<int> newest_{-1};
  std::atomic<std::uint64_t> replaced_{0};
};

// A force in one word, passed between threads without locks; any thread can replace it by zero.

/// Steps of 20 uN up to 20.9 N per axis: finer than any device's motors, stronger than the devices here. A
/// larger force is scaled, so its direction stays. Any threads; wait-free.
class PackedForce {
 public:
  void store(const Vec3& force_n) noexcept { word_.store(packed(force_n), std::memory_order_release); }
  void zero() noexcept { word_.store(0, std::memory_order_release); }
  [[nodiscard]] Vec3 load() const noexcept {
    const std::uint64_t word = word_.load(std::memory_order_acquire);
    return Vec3{part(word, 0), part(word, 1), part(word, 2)};
  }

  static constexpr double kStepN = 20e-6;

 private:
  static constexpr int kBits = 21;  // three in 64 bits
  static constexpr std::int64_t kMost = (std::int64_t{1} << (kBits - 1)) - 1;
  static constexpr std::uint64_t kMask = (std::uint64_t{1} << kBits) - 1;

  [[nodiscard]] static std::uint64_t packed(const Vec3& force_n) noexcept {
    Vec3 steps = force_n / kStepN;
    if (!is_finite(steps)) return 0;  // excluded by the governor
    const double largest = steps.cwiseAbs().maxCoeff(), most = static_cast<double>(kMost);
    if (largest > most) steps *= most / largest;
    std::uint64_t word = 0;
    for (int axis = 0; axis < 3; ++axis)
      word |= (static_cast<std::uint64_t>(std::llround(std::clamp(steps[axis], -most, most))) & kMask)
              << (kBits * axis);
    return word;
  }
  [[nodiscard]] static double part(std::uint64_t word, int axis) noexcept {
    const auto bits = static_cast<std::int64_t>((word >> (kBits * axis)) & kMask);
    return kStepN * static_cast<double>(bits > kMost ? bits - (kMost + 1) * 2 : bits);
  }

  std::atomic<std::uint64_t> word_{0};
  static_assert(std::atomic<std::uint64_t>::is_always_lock_free);
};

}  // namespace palpate::device
