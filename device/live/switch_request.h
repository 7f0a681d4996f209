// What somebody asks of a mixer, passed from any thread to the servo's: a single slot without a lock, in
// which the newest request replaces one that was not taken yet.
#pragma once

#include <atomic>
#include <cstdint>

namespace palpate::device {

/// Who asked.
enum class SwitchSource : std::uint8_t { kProgram, kKey, kButton, kTimer, kParameters };
[[nodiscard]] constexpr const char* source_text(SwitchSource source) noexcept {
  switch (source) {
    case SwitchSource::kProgram:
      return "program";
    case SwitchSource::kKey:
      return "key";
    case SwitchSource::kButton:
      return "button";
    case SwitchSource::kTimer:
      return "timer";
    case SwitchSource::kParameters:
      return "parameters";
  }
  return "unknown";
}

struct SwitchRequest {
  enum class Kind : std::uint8_t {
    kNone,
    kSelect,  ///< the renderer of this lane
    kNext,    ///< the one after the one that is felt, in the order of lanes
    kCancel,  ///< nothing waits any more; a fade goes on to its end
  };
  Kind kind = Kind::kNone;
  SwitchSource source = SwitchSource::kProgram;
  std::uint8_t lane = 0;  ///< of kSelect

  [[nodiscard]] bool operator==(const SwitchRequest&) const = default;
};

/// Any threads post, one takes. Wait-free both.
class RequestSlot {
 public:
  void post(const SwitchRequest& request) noexcept {
    // Release: what the poster did before is seen by who acts on the request.
    slot_.store(packed(request), std::memory_order_release);
  }
  /// What stands there, and empties it; kNone where nothing does.
  [[nodiscard]] SwitchRequest take() noexcept {
    return unpacked(slot_.exchange(0, std::memory_order_acquire));
  }
  /// Without taking it.
  [[nodiscard]] SwitchRequest peek() const noexcept {
    return unpacked(slot_.load(std::memory_order_acquire));
  }

 private:
  static constexpr unsigned kSourceShift = 8, kLaneShift = 16;
  static constexpr std::uint32_t kByte = 0xff;
  static constexpr std::uint32_t packed(const SwitchRequest& r) noexcept {
    return static_cast<std::uint32_t>(r.kind) | static_cast<std::uint32_t>(r.source) << kSourceShift |
           static_cast<std::uint32_t>(r.lane) << kLaneShift;
  }
  static constexpr SwitchRequest unpacked(std::uint32_t bits) noexcept {
    return {static_cast<SwitchRequest::Kind>(bits & kByte),
            static_cast<SwitchSource>(bits >> kSourceShift & kByte),
            static_cast<std::uint8_t>(bits >> kLaneShift & kByte)};
  }
  std::atomic<std::uint32_t> slot_{0};
  static_assert(std::atomic<std::uint32_t>::is_always_lock_free);
};

}  // namespace palpate::device
