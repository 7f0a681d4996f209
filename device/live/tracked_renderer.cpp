#include "device/live/tracked_renderer.h"

#include <algorithm>
#include <utility>

namespace palpate::device {
namespace {

// A standby's bring-up runs beside the renderer that is felt: four frames at once, of 16 that a renderer
// alone may take, are a quarter of what the shortest period has room for.
constexpr render::BringUpOptions kBesideAnother{render::BringUpOptions{}.step_mm, 4};
// The mean forgets over so many frames: longer than what the processor's caches and clock need, short against
// a person's patience.
constexpr double kMeanFrames = 64.0;
// A missed budget costs as much as so many frames in time pay back, and so much debt is too much: three
// misses in a row, or more than one in fifty for some time. One alone is the operating system's.
constexpr int kDebtOfAMiss = 50;
constexpr int kDebtMost = 3 * kDebtOfAMiss - 2;

}  // namespace

const char* disqualified_text(Disqualified disqualified) noexcept {
  switch (disqualified) {
    case Disqualified::kNo:
      return "";
    case Disqualified::kNonFinite:
      return "it answered a force that is no number";
    case Disqualified::kTooSlow:
      return "its frames do not fit into the period";
  }
  return "unknown";
}

void TrackedRenderer::adopt(std::unique_ptr<render::HapticRenderer> renderer, std::uint32_t generation,
                            const std::optional<Vec3>& free_mm, double t_s) noexcept {
  renderer_ = std::move(renderer);
  generation_ = generation;
  frame_ = {};
  stepped_ = timed_ = false;
  step_ns_ = 0;
  mean_ns_ = 0.0;
  debt_ = 0;
  disqualified_ = Disqualified::kNo;
  bring_up_ = render::BringUp(kBesideAnother);
  watch_.restart(t_s);
  last_free_mm_ = free_mm;
  if (free_mm) bring_up_.begin(*renderer_, *free_mm, t_s);
}

std::unique_ptr<render::HapticRenderer> TrackedRenderer::release() noexcept {
  disqualified_ = Disqualified::kNo;
  stepped_ = false;
  last_free_mm_.reset();
  return std::move(renderer_);
}

void TrackedRenderer::restart(const Vec3& hip_mm, double t_s) noexcept {
  renderer_->restart(hip_mm, t_s);
  bring_up_.abandon();
  disqualified_ = Disqualified::kNo;
  debt_ = 0;
  frame_ = {};
  frame_.god_object_mm = hip_mm;
  watch_.restart(t_s);
  last_free_mm_ = hip_mm;
}

void TrackedRenderer::let_go(const Vec3& hip_mm, double t_s) noexcept {
  frame_ = {};
  frame_.god_object_mm = hip_mm;
  watch_.restart(t_s);
  if (!last_free_mm_) last_free_mm_ = hip_mm;
  if (*last_free_mm_ == hip_mm)
    place(hip_mm);
  else
    bring_up_.begin(*renderer_, *last_free_mm_, t_s);
}

void TrackedRenderer::place(const Vec3& hip_mm) noexcept {
  bring_up_.abandon();
  renderer_->let_go(hip_mm);
  last_free_mm_ = hip_mm;
}

void TrackedRenderer::step(const Vec3& hip_mm, double t_s, const Clock& clock, const Clock& shown,
                           double spare_ns, const SwitchOptions& options) noexcept {
  const bool one_clock = &clock == &shown;
  const std::int64_t begun_ns = clock.now_ns(), shown_ns = one_clock ? begun_ns : shown.now_ns();
  const bool on_the_way = bring_up_.pending();
  frame_ = on_the_way ? bring_up_.advance(*renderer_, hip_mm, t_s) : renderer_->step(hip_mm, t_s);
  step_ns_ = shown.now_ns() - shown_ns;
  const std::int64_t took_ns = one_clock ? step_ns_ : clock.now_ns() - begun_ns;
  stepped_ = true;
  if (!is_finite(frame_.force_n)) {
    disqualified_ = Disqualified::kNonFinite;
    return;
  }
  if (bring_up_.pending()) frame_.force_n.setZero();  // of a place on the way
  if (on_the_way) {
    watch_.disturb(t_s);
    return;
  }
  watch_.observe(hip_mm, frame_.contact, frame_.force_n.norm(), t_s, options);
  if (!frame_.contact) last_free_mm_ = hip_mm;
  judge_time(static_cast<double>(took_ns), spare_ns, options);
}

void TrackedRenderer::judge_time(double took_ns, double spare_ns, const SwitchOptions& options) noexcept {
  // A frame that the operating system interrupted counts for a period at most.
  const double counted_ns = std::min(took_ns, options.period_s * kFrameNsPerS);
  mean_ns_ = timed_ ? mean_ns_ + (counted_ns - mean_ns_) / kMeanFrames : counted_ns;
  timed_ = true;
  debt_ = took_ns > spare_ns ? debt_ + kDebtOfAMiss : std::max(0, debt_ - 1);
  if (debt_ >= kDebtMost) disqualified_ = Disqualified::kTooSlow;
}

}  // namespace palpate::device
