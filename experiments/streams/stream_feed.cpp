#include "experiments/streams/stream_feed.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <vector>

#include <palpate/options.h>
#include "toolkit/core/messages.h"
#include "toolkit/core/statistics.h"
#include "toolkit/render/depth_camera.h"

namespace palpate::experiments {
namespace {

constexpr double kFeedSPerMs = 1e-3;

}  // namespace

Result<StreamDelay> parse_stream_delay(const std::string& text) {
  StreamDelay delay;
  if (text.empty()) return delay;
  delay.measured = text == "measured";
  if (delay.measured) return delay;
  const Result<double> ms = read_number(text, {0.0, StreamDelay::kMostMs});
  if (!ms)
    return Error{fmt::format("--stream-delay {} is neither measured nor milliseconds: {}", shown(text),
                             ms.error().what),
                 fmt::format("give measured, or a number such as {:g}", StreamDelay::kUsualMs)};
  delay.ms = *ms;
  return delay;
}

StreamFeed::StreamFeed(const StreamFrames& stream, stream::DepthReceiver& receiver,
                       const trace::ProbePath& path, const StreamDelay& delay)
    : stream_(stream), receiver_(receiver), path_(path), delay_(delay) {
  schedule_.reserve(stream.frames.size());
  while (!delay.measured && extend()) {
  }
}

/// Appends the next frame's turn.
bool StreamFeed::extend() noexcept {
  const auto& frames = stream_.frames;
  std::size_t next = schedule_.empty() ? 0 : schedule_.back().frame + 1;
  if (next == frames.size()) return false;
  double due_s = frames[next].arrived_s + delay_.ms * kFeedSPerMs;
  if (delay_.measured) {
    const double begun_s = std::max(free_s_, frames[next].arrived_s);
    while (next + 1 < frames.size() && frames[next + 1].arrived_s <= begun_s) ++next;
    due_s = begun_s + (schedule_.empty() ? 0.0 : schedule_.back().report.window_ms * kFeedSPerMs);
  }
  if (!schedule_.empty()) due_s = std::max(due_s, schedule_.back().due_s);
  schedule_.push_back({next, frames[next].captured_s, due_s, {}});
  return true;
}

void StreamFeed::reset() noexcept {
  receiver_.forget_frames();
  given_ = sample_ = 0;
}

void StreamFeed::advance(double t_s) noexcept {
  while (given_ < schedule_.size() || (delay_.measured && extend())) {
    metrics::StreamDelivery& turn = schedule_[given_];
    if (turn.due_s > t_s) return;
    while (sample_ + 1 < path_.size() && path_.t_s[sample_ + 1] < turn.due_s) ++sample_;
    turn.report = receiver_.receive(stream_.frames[turn.frame], path_.hip_mm[sample_]);
    ++given_;
    if (given_ == schedule_.size())
      free_s_ = std::max(free_s_, stream_.frames[turn.frame].arrived_s) + turn.report.whole_ms * kFeedSPerMs;
  }
}

double StreamFeed::next_s() const noexcept {
  return given_ < schedule_.size() ? schedule_[given_].due_s : HUGE_VAL;
}

std::uint64_t StreamFeed::skipped() const noexcept {
  return given_ == 0 ? 0 : schedule_[given_ - 1].frame + 1 - given_;
}

namespace {

constexpr double kHandStepS = 1e-3;  // the haptic frame
// The mean press sinks in by this share of the depth: 3 mm at 1 m. It swings once in 1.3 s.
constexpr double kPressPerDepth = 3e-3, kMeanPress = 0.8, kPressSwing = 0.15, kPressPeriodS = 1.3;
// Below this the hand yields like a spring, above like its damper. A wall of 50 mm at 1 Hz comes at 0.3 m/s,
// which 30 Hz turn into 0.8 N: less than the lightest press, so that the hand follows it both ways.
constexpr double kHandHz = 30.0;
// A lift every 2.3 s for 0.25 s, at a fifth of the fastest slide.
constexpr double kLiftEveryS = 2.3, kLiftS = 0.25, kLiftShare = 0.2;
// The hand starts this share of the depth in front of the nearest pixel, and returns from as far behind the
// farthest.
constexpr double kClearPerDepth = 0.04;
// Slides over the middle half of the view, the rows' frequency in the golden ratio to the columns'.
constexpr double kSlideShare = 0.5;
// Slow and fast slides take turns: 20 to 100 % of the fastest, in 4 s.
constexpr double kSlowest = 0.2, kPacePeriodS = 4.0;
// The way back onto the curve after the surface has held the hand, 1/s.
constexpr double kReturnHz = 5.0;
// Percentiles of depths that stand for the nearest and the farthest: noise and flying pixels lie beyond.
constexpr double kNearPercent = 1.0, kFarPercent = 99.0, kHandMedian = 50.0;

const std::vector<OptionSpec>& hand_options() {
  static const std::vector<OptionSpec> kOptions = {
      {"frames", OptionKind::kInteger, "5000", "HIP positions, 1000 a second", {}, 2, 1e7},
      {"fastest",
       OptionKind::kNumber,
       "0.5",
       "fastest slide, median depths of the image a second",
       {},
       0.01,
       10.0}};
  return kOptions;
}

double turns(double t_s, double period_s) {
  return 2.0 * std::numbers::pi * t_s / period_s;
}

}  // namespace

Result<HandView> view_of(const stream::DepthFrame& frame, const stream::DepthCamera& camera) {
  std::vector<double> depths;
  const auto width = static_cast<std::size_t>(camera.width), height = static_cast<std::size_t>(camera.height);
  for (std::size_t row = height / 4; row < height - height / 4; ++row)
    for (std::size_t column = width / 4; column < width - width / 4; ++column)
      if (const float z = frame.depth_mm[row * width + column]; render::is_measured(z))
        depths.push_back(static_cast<double>(z));
  if (depths.empty()) return Error{"the middle of its first image holds no depth", "name a path with --path"};
  std::sort(depths.begin(), depths.end());
  HandView view;
  view.world_from_camera = frame.world_from_camera;
  view.nearest_mm = nearest_rank(depths, kNearPercent);
  view.median_mm = nearest_rank(depths, kHandMedian);
  view.farthest_mm = nearest_rank(depths, kFarPercent);
  view.half_width_mm = 0.5 * camera.width / camera.fx_px * view.median_mm;
  view.half_height_mm = 0.5 * camera.height / camera.fy_px * view.median_mm;
  return view;
}

Result<NamedOptions> parse_press_and_slide(const std::string& text) {
  PALPATE_ASSIGN(NamedOptions named, parse_named_options(text.empty() ? kPressAndSlide : text));
  if (named.name != kPressAndSlide)
    return Error{shown(named.name) + " is another path", fmt::format("give {}:frames=5000", kPressAndSlide)};
  PALPATE_ASSIGN(named.options, validate(named.options, hand_options(), named.name));
  return named;
}

void press_and_slide(const HandView& view, double stiffness_n_per_mm, const NamedOptions& options,
                     const FeltForce& felt, trace::ProbePath& path) {
  const auto frames = static_cast<std::size_t>(options.options.integer("frames"));
  const double fastest_mm_s = options.options.number("fastest") * view.median_mm;
  const double damping = stiffness_n_per_mm / (2.0 * std::numbers::pi * kHandHz);
  const double press_n = kPressPerDepth * view.median_mm * stiffness_n_per_mm;
  const double clear_mm = kClearPerDepth * view.median_mm;
  const double width_mm = kSlideShare * view.half_width_mm, height_mm = kSlideShare * view.half_height_mm;
  // Speed of a Lissajous curve: at most the root of both axes' squares.
  const double rate = fastest_mm_s / std::hypot(width_mm, height_mm / std::numbers::phi);
  path.t_s.reserve(path.size() + frames);
  path.hip_mm.reserve(path.hip_mm.size() + frames);
  Vec3 h(0.0, 0.0, view.nearest_mm - clear_mm);  // camera axes
  double phase = 0.0;
  bool returns = false;  // the way it came: where there was nothing
  for (std::size_t k = 0; k < frames; ++k) {
    const double t = static_cast<double>(k) * kHandStepS;
    const Vec3 hip = view.world_from_camera * h;
    path.t_s.push_back(t);
    path.hip_mm.push_back(hip);
    const Vec3 force = view.world_from_camera.inverse().rotate(felt(hip, t));
    double own_n = press_n * (kMeanPress + kPressSwing * std::sin(turns(t, kPressPeriodS)));
    if (std::fmod(t, kLiftEveryS) > kLiftEveryS - kLiftS) own_n = -kLiftShare * fastest_mm_s * damping;
    if (h.z() > view.farthest_mm + clear_mm && force.isZero()) returns = true;
    if (h.z() < view.nearest_mm) returns = false;
    if (returns) own_n = -press_n;
    const double pace = kSlowest + (1.0 - kSlowest) * 0.5 * (1.0 - std::cos(turns(t, kPacePeriodS)));
    phase += rate * pace * kHandStepS;
    const Vec3 goal(width_mm * std::sin(phase), height_mm * std::sin(phase / std::numbers::phi), 0.0);
    const Vec3 slide(rate * pace * width_mm * std::cos(phase),
                     rate * pace * height_mm / std::numbers::phi * std::cos(phase / std::numbers::phi), 0.0);
    Vec3 velocity = (Vec3(0.0, 0.0, own_n) + force) / damping;
    if (!returns) velocity += slide + kReturnHz * Vec3(goal.x() - h.x(), goal.y() - h.y(), 0.0);
    if (const double fast = velocity.norm(); fast > fastest_mm_s) velocity *= fastest_mm_s / fast;
    h += velocity * kHandStepS;
  }
  path.name = options.name;
  for (const auto& [key, value] : options.options.all()) path.name += fmt::format(":{}={}", key, value);
}

}  // namespace palpate::experiments
