// Lock-free exchange between a plug-in's thread and the servo's. Header only: plug-ins link nothing of
// Palpate.
#pragma once

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstring>
#include <string_view>

#include <palpate/clock.h>
#include <palpate/triple_buffer.h>
#include "device/links/newest_command.h"
#include "device/plugins/plugin.h"

namespace palpate::device {

/// Copies a text to a C buffer, cut to its size and zero-terminated.
inline void copy_plugin_text(std::string_view text, char* into, std::uint32_t size) noexcept {
  if (into == nullptr || size == 0) return;
  const std::size_t length = std::min<std::size_t>(text.size(), size - 1);
  std::memcpy(into, text.data(), length);
  into[length] = '\0';
}

/// One device. The library's thread calls state() and force(), the servo's read() and send(), any thread
/// zero().
class PluginExchange {
 public:
  /// Without send() for this long the force ends: no servo survives such a pause (50 ms).
  static constexpr std::int64_t kHeldNs = 50'000'000;

  /// Library's thread: publishes a measured state.
  void state(const palpate_plugin_state& now) noexcept { states_.publish({now, monotonic_ns()}); }
  /// Library's thread: the force to show now.
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
  TripleBuffer<Timed> states_;
  PackedForce force_;
  std::atomic<std::int64_t> sent_ns_{0};
};

/// Calls of a plug-in whose device, of type D, has an `exchange`.
template <class D>
struct PluginCalls {
  static D& device_of(void* device) noexcept { return *static_cast<D*>(device); }
  static std::int32_t read(void* device, palpate_plugin_state* state) {
    device_of(device).exchange.read(*state);
    return 0;
  }
  static std::int32_t send(void* device, const double force_n[3]) {
    device_of(device).exchange.send(force_n);
    return 0;
  }
  static std::int32_t zero(void* device) {
    device_of(device).exchange.zero();
    return 0;
  }
};

}  // namespace palpate::device
