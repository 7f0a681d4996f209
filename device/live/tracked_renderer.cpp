#include "device/live/tracked_renderer.h"

#include <algorithm>
#include <utility>

namespace palpate::device {
namespace {

// Bring-up frames at once beside the felt renderer (16 alone): a quarter of the shortest period.
constexpr render::ContactCatchUpOptions kBesideAnother{render::ContactCatchUpOptions{}.step_mm, 4};
// Frames of the running mean: more than caches and clock rate need, short for a user.
constexpr double kMeanFrames = 64.0;
// A missed budget costs this many frames in time; the debt limit is three misses in a row, or over one in
// fifty for some time. A single one is the operating system's.
constexpr int kMissedBudgetScore = 50;
constexpr int kDebtMost = 3 * kMissedBudgetScore - 2;

}  // namespace

const char* disqualified_text(Disqualified disqualified) noexcept {
  return disqualified == Disqualified::kNo          ? ""
         : disqualified == Disqualified::kNonFinite ? "it answered a force that is no number"
                                                    : "its frames do not fit into the period";
}

void TrackedRenderer::adopt(std::unique_ptr<render::HapticRenderer> renderer, std::uint32_t generation,
                            const std::optional<Vec3>& free_mm, double t_s) noexcept {
  renderer_ = std::move(renderer);
  generation_ = generation;
  frame_ = {};
  stepped_ = timed_ = false;
  step_ns_ = 0;
  mean_ns_ = 0.0;
  missed_budget_score_ = 0;
  disqualified_ = Disqualified::kNo;
  catch_up_ = render::ContactCatchUp(kBesideAnother);
  watch_.restart(t_s);
  last_free_mm_ = free_mm;
  if (free_mm) catch_up_.begin(*renderer_, *free_mm, t_s);
}

std::unique_ptr<render::HapticRenderer> TrackedRenderer::release() noexcept {
  disqualified_ = Disqualified::kNo;
  stepped_ = false;
  last_free_mm_.reset();
  return std::move(renderer_);
}

void TrackedRenderer::restart(const Vec3& hip_mm, double t_s) noexcept {
  renderer_->restart(hip_mm, t_s);
  catch_up_.abandon();
  disqualified_ = Disqualified::kNo;
  missed_budget_score_ = 0;
  frame_ = {};
  frame_.god_object_mm = hip_mm;
  watch_.restart(t_s);
  last_free_mm_ = hip_mm;
}

void TrackedRenderer::release_contact(const Vec3& hip_mm, double t_s) noexcept {
  frame_ = {};
  frame_.god_object_mm = hip_mm;
  watch_.restart(t_s);
  if (!last_free_mm_) last_free_mm_ = hip_mm;
  if (*last_free_mm_ == hip_mm)
    place(hip_mm);
  else
    catch_up_.begin(*renderer_, *last_free_mm_, t_s);
}

void TrackedRenderer::place(const Vec3& hip_mm) noexcept {
  catch_up_.abandon();
  renderer_->release_contact(hip_mm);
  last_free_mm_ = hip_mm;
}

void TrackedRenderer::step(const Vec3& hip_mm, double t_s, const Clock& clock, const Clock& shown,
                           double spare_ns, const SwitchOptions& options) noexcept {
  const bool one_clock = &clock == &shown;
  const std::int64_t begun_ns = clock.now_ns(), shown_ns = one_clock ? begun_ns : shown.now_ns();
  const bool on_the_way = catch_up_.pending();
  frame_ = on_the_way ? catch_up_.advance(*renderer_, hip_mm, t_s) : renderer_->step(hip_mm, t_s);
  step_ns_ = shown.now_ns() - shown_ns;
  const std::int64_t took_ns = one_clock ? step_ns_ : clock.now_ns() - begun_ns;
  stepped_ = true;
  if (!is_finite(frame_.force_n)) {
    disqualified_ = Disqualified::kNonFinite;
    return;
  }
  if (catch_up_.pending()) frame_.force_n.setZero();  // on the way, not at the hand
  if (on_the_way) {
    watch_.disturb(t_s);
    return;
  }
  watch_.observe(hip_mm, frame_.contact, frame_.force_n.norm(), t_s, options);
  if (!frame_.contact) last_free_mm_ = hip_mm;
  judge_time(static_cast<double>(took_ns), spare_ns, options);
}

void TrackedRenderer::judge_time(double took_ns, double spare_ns, const SwitchOptions& options) noexcept {
  // An interrupted frame counts as at most a period.
  const double counted_ns = std::min(took_ns, options.period_s * kFrameNsPerS);
  mean_ns_ = timed_ ? mean_ns_ + (counted_ns - mean_ns_) / kMeanFrames : counted_ns;
  timed_ = true;
  missed_budget_score_ =
      took_ns > spare_ns ? missed_budget_score_ + kMissedBudgetScore : std::max(0, missed_budget_score_ - 1);
  if (missed_budget_score_ >= kDebtMost) disqualified_ = Disqualified::kTooSlow;
}

}  // namespace palpate::device
