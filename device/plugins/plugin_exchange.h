// For plug-ins: what the thread of a maker's library and the servo's thread hand each other, without a lock.
// Header only: a plug-in links nothing of Palpate.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <string_view>

#include "device/links/packed_force.h"
#include "device/plugins/plugin.h"
#include "toolkit/core/clock.h"
#include "toolkit/core/handover.h"

namespace palpate::device {

/// A text into memory of C, cut to its size, ended by a zero.
inline void copy_plugin_text(std::string_view text, char* into, std::uint32_t size) noexcept {
  if (into == nullptr || size == 0) return;
  const std::size_t length = std::min<std::size_t>(text.size(), size - 1);
  std::memcpy(into, text.data(), length);
  into[length] = '\0';
}

/// One device. The library's thread calls state() and force(), the servo's read() and send(), any zero().
class PluginExchange {
 public:
  /// Longer than any hiccup that a servo survives (its own limit is 50 ms): nobody is there any more.
  static constexpr std::int64_t kHeldNs = 50'000'000;

  /// The library's thread: what was measured now.
  void state(const palpate_plugin_state& now) noexcept { states_.publish({now, monotonic_ns()}); }
  /// The library's thread: what is to be shown now.
  [[nodiscard]] Vec3 force() const noexcept {
    if (monotonic_ns() - sent_ns_.load(std::memory_order_acquire) > kHeldNs) return Vec3::Zero();
    return force_.load();
  }

  void read(palpate_plugin_state& into) noexcept {
    const bool fresh = states_.acquire();
    into = states_.front().state;
    into.age_ns = monotonic_ns() - states_.front().at_ns;
    constexpr std::uint32_t kFreshState = 0, kNothingNewState = 1;
    if (!fresh && into.status == kFreshState) into.status = kNothingNewState;
  }
  void send(const double force_n[3]) noexcept {
    force_.store(Vec3{force_n[0], force_n[1], force_n[2]});
    sent_ns_.store(monotonic_ns(), std::memory_order_release);
  }
  void zero() noexcept { force_.zero(); }

 private:
  struct Timed {
    palpate_plugin_state state{{0.0, 0.0, 0.0}, 0, 1, 0, 0, 0};
    std::int64_t at_ns = 0;
  };
  Handover<Timed> states_;
  PackedForce force_;
  std::atomic<std::int64_t> sent_ns_{0};
};

}  // namespace palpate::device
