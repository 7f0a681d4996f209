// One of several renderers at the same HIP: its last answer, bring-up, frame times, and whether it may be
// felt.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>

#include <palpate/clock.h>
#include <palpate/device/contact_catch_up.h>
#include <palpate/renderer.h>
#include "device/live/switch_rules.h"

namespace palpate::device {

/// Frame times are in ns, periods in s.
inline constexpr double kFrameNsPerS = 1e9;

/// Why a renderer is excluded until the next restart.
enum class Disqualified : std::uint8_t {
  kNo,
  kNonFinite,  ///< it answered a NaN force
  kTooSlow,    ///< its frames do not fit beside the felt renderer's
};
[[nodiscard]] const char* disqualified_text(Disqualified disqualified) noexcept;

/// For the servo thread. Only assigning `renderer` allocates.
class TrackedRenderer {
 public:
  /// Takes a renderer, to be brought up from `free_mm`, known to be free; without it the next restart()
  /// places it.
  void adopt(std::unique_ptr<render::HapticRenderer> renderer, std::uint32_t generation,
             const std::optional<Vec3>& free_mm, double t_s) noexcept;
  /// Gives the renderer away.
  [[nodiscard]] std::unique_ptr<render::HapticRenderer> release() noexcept;

  [[nodiscard]] bool present() const noexcept { return renderer_ != nullptr; }
  [[nodiscard]] std::uint32_t generation() const noexcept { return generation_; }
  [[nodiscard]] const render::HapticRenderer& renderer() const noexcept { return *renderer_; }
  [[nodiscard]] render::HapticRenderer& renderer() noexcept { return *renderer_; }

  void restart(const Vec3& hip_mm, double t_s) noexcept;
  /// Returns to its last free place (`hip_mm` if none) and is brought up from there.
  void release_contact(const Vec3& hip_mm, double t_s) noexcept;
  /// The HIP is known to be free: continues from there at once.
  void place(const Vec3& hip_mm) noexcept;

  /// A frame, or steps of the bring-up. `clock` gives the time that judges it, `shown` (perhaps the same) the
  /// time displayed. `spare_ns`: its budget.
  void step(const Vec3& hip_mm, double t_s, const Clock& clock, const Clock& shown, double spare_ns,
            const SwitchOptions& options) noexcept;
  /// Not stepped in this frame: keeps the last answer.
  void skip() noexcept { stepped_ = false; }

  /// Of its last step; no force during bring-up.
  [[nodiscard]] const render::Frame& frame() const noexcept { return frame_; }
  [[nodiscard]] bool stepped() const noexcept { return stepped_; }
  [[nodiscard]] std::int64_t step_ns() const noexcept { return step_ns_; }  ///< 0: not stepped
  /// Running mean of its frame times.
  [[nodiscard]] double mean_ns() const noexcept { return mean_ns_; }
  [[nodiscard]] bool ready() const noexcept { return !catch_up_.pending(); }
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
  bool timed_ = false;           // mean_ns_ has a first value
  int missed_budget_score_ = 0;  // from missed budgets
  Disqualified disqualified_ = Disqualified::kNo;
  render::ContactCatchUp catch_up_;
  FreeWatch watch_;
  std::optional<Vec3> last_free_mm_;
};

}  // namespace palpate::device
