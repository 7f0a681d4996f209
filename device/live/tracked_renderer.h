// One of several renderers that follow the same HIP: its last answer, whether it has to be brought to the
// hand first, what its frames take, and whether it may still be felt.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include "device/live/switch_rules.h"
#include "toolkit/core/clock.h"
#include "toolkit/render/bring_up.h"
#include "toolkit/render/renderer.h"

namespace palpate::device {

/// Times of frames are in ns, periods in s.
inline constexpr double kFrameNsPerS = 1e9;

/// Why a renderer is never faded to any more, until the next restart.
enum class Disqualified : std::uint8_t {
  kNo,
  kNonFinite,  ///< it answered a force that is no number
  kTooSlow,    ///< its frames do not fit beside the renderer that is felt
};
[[nodiscard]] const char* disqualified_text(Disqualified disqualified) noexcept;

/// The servo thread's. Nothing is allocated but by assigning `renderer`.
class TrackedRenderer {
 public:
  /// Takes it: it is brought up from `free_mm`, a place known to be free, where there is one; without one the
  /// next restart() places it.
  void adopt(std::unique_ptr<render::HapticRenderer> renderer, std::uint32_t generation,
             const std::optional<Vec3>& free_mm, double t_s) noexcept;
  /// Gives it away; the place is empty then.
  [[nodiscard]] std::unique_ptr<render::HapticRenderer> release() noexcept;

  [[nodiscard]] bool present() const noexcept { return renderer_ != nullptr; }
  [[nodiscard]] std::uint32_t generation() const noexcept { return generation_; }
  [[nodiscard]] const render::HapticRenderer& renderer() const noexcept { return *renderer_; }
  [[nodiscard]] render::HapticRenderer& renderer() noexcept { return *renderer_; }

  void restart(const Vec3& hip_mm, double t_s) noexcept;
  /// Goes back to where it was last free, `hip_mm` where it never was, and is brought up from there.
  void let_go(const Vec3& hip_mm, double t_s) noexcept;
  /// The HIP is known to be free: it goes on from there at once.
  void place(const Vec3& hip_mm) noexcept;

  /// A frame, or some steps of the bring-up; timed by `clock`, and judged by that; what is shown is timed by
  /// `shown`, which may be the same. `spare_ns`: what its frame may take.
  void step(const Vec3& hip_mm, double t_s, const Clock& clock, const Clock& shown, double spare_ns,
            const SwitchOptions& options) noexcept;
  /// Not in this frame: the last answer stays.
  void skip() noexcept { stepped_ = false; }

  /// Of the last frame in which it was stepped; no force while it is being brought up.
  [[nodiscard]] const render::Frame& frame() const noexcept { return frame_; }
  [[nodiscard]] bool stepped() const noexcept { return stepped_; }
  [[nodiscard]] std::int64_t step_ns() const noexcept { return step_ns_; }  ///< 0: not stepped
  /// A running mean of what its frames take.
  [[nodiscard]] double mean_ns() const noexcept { return mean_ns_; }
  [[nodiscard]] bool ready() const noexcept { return !bring_up_.pending(); }
  [[nodiscard]] Disqualified disqualified() const noexcept { return disqualified_; }
  [[nodiscard]] bool healthy() const noexcept { return present() && disqualified_ == Disqualified::kNo; }
  [[nodiscard]] bool is_free(const Vec3& hip_mm, double t_s, const SwitchOptions& options) const noexcept {
    return watch_.is_free(hip_mm, t_s, options);
  }
  [[nodiscard]] const std::optional<Vec3>& last_free_mm() const noexcept { return last_free_mm_; }

 private:
  void judge_time(double took_ns, double spare_ns, const SwitchOptions& options) noexcept;

  std::unique_ptr<render::HapticRenderer> renderer_;
  std::uint32_t generation_ = 0;
  render::Frame frame_;
  bool stepped_ = false;
  std::int64_t step_ns_ = 0;
  double mean_ns_ = 0.0;
  bool timed_ = false;  // mean_ns_ has a first value
  int debt_ = 0;        // of missed budgets
  Disqualified disqualified_ = Disqualified::kNo;
  render::BringUp bring_up_;
  FreeWatch watch_;
  std::optional<Vec3> last_free_mm_;
};

}  // namespace palpate::device
