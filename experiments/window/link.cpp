#include "experiments/window/link.h"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

namespace palpate::experiments {
namespace {

constexpr double kLinkNsPerS = 1e9;

}  // namespace

double SessionLink::since_begin_s() const {
  return static_cast<double>(monotonic_ns() - begun_ns_) / kLinkNsPerS;
}

void SessionLink::show(std::shared_ptr<const ShownScene> scene) {
  const std::scoped_lock lock(mutex_);
  view_.scene = std::move(scene);
  view_.shown_s = since_begin_s();
}

void SessionLink::progress(std::string_view what, double fraction) {
  const std::scoped_lock lock(mutex_);
  view_.phase = what;
  view_.fraction = fraction;
}

void SessionLink::running(std::shared_ptr<const ShownSession> session, SessionActions actions) {
  const std::scoped_lock lock(mutex_);
  view_.session = std::move(session);
  view_.phase.clear();
  actions_ = std::move(actions);
  if (stop_asked() && actions_.stop) actions_.stop();
}

void SessionLink::ended() {
  const std::scoped_lock lock(mutex_);
  actions_ = {};
  view_.session.reset();
}

std::vector<std::string> SessionLink::take_changes() {
  const std::scoped_lock lock(mutex_);
  return std::exchange(changes_, {});
}

void SessionLink::answer(std::string sentence) {
  const std::scoped_lock lock(mutex_);
  view_.answer = std::move(sentence);
}

SessionLink::View SessionLink::view() const {
  const std::scoped_lock lock(mutex_);
  return view_;
}

void SessionLink::request(const device::SwitchRequest& request) {
  const std::scoped_lock lock(mutex_);
  if (actions_.switch_to) actions_.switch_to(request);
}

void SessionLink::rearm() {
  const std::scoped_lock lock(mutex_);
  if (actions_.rearm) actions_.rearm();
}

void SessionLink::mark(const std::string& text) {
  const std::scoped_lock lock(mutex_);
  if (!actions_.mark) {
    view_.answer =
        "Nothing is recorded, so there is nothing to mark: press Record, or start with --record FILE.";
    return;
  }
  const Status marked = actions_.mark(text);
  view_.answer = marked ? "Marked in the recording: " + text : marked.error().message();
}

std::string SessionLink::homing_prompt() const {
  const std::scoped_lock lock(mutex_);
  return actions_.homing_prompt ? actions_.homing_prompt() : std::string();
}

void SessionLink::change(std::string text) {
  const std::scoped_lock lock(mutex_);
  changes_.push_back(std::move(text));
}

void SessionLink::ask_stop() {
  stop_.store(true, std::memory_order_release);
  const std::scoped_lock lock(mutex_);
  if (actions_.stop) actions_.stop();
}

void SessionLink::touchable() {
  const std::scoped_lock lock(mutex_);
  if (view_.touchable_s < 0.0) view_.touchable_s = since_begin_s();
}

void SessionLink::felt() {
  const std::scoped_lock lock(mutex_);
  if (view_.felt_s < 0.0) view_.felt_s = since_begin_s();
}

void SessionLink::begin(std::int64_t from_ns) {
  const std::scoped_lock lock(mutex_);
  view_ = {};
  actions_ = {};
  changes_.clear();
  begun_ns_ = from_ns;
  stop_.store(false, std::memory_order_release);
}

namespace {

constexpr double kUsPerNs = 1e-3;

}  // namespace

void SampleRing::push(const TickSample& sample) noexcept {
  const std::uint64_t at = written_.load(std::memory_order_relaxed);
  // Acquire: the reader has finished with the slot that is overwritten.
  if (at - read_.load(std::memory_order_acquire) >= kSize) {
    lost_.fetch_add(1, std::memory_order_relaxed);
    return;
  }
  ring_[at % kSize] = sample;
  written_.store(at + 1, std::memory_order_release);
}

std::size_t SampleRing::drain(std::vector<TickSample>& into) {
  const std::uint64_t end = written_.load(std::memory_order_acquire);
  std::uint64_t at = read_.load(std::memory_order_relaxed);
  const auto count = static_cast<std::size_t>(end - at);
  for (; at < end; ++at) into.push_back(ring_[at % kSize]);
  read_.store(end, std::memory_order_release);
  return count;
}

WindowFeed::WindowFeed(const device::Servo& servo, const device::Mixer& mixer,
                       std::vector<std::shared_ptr<render::MovingModel>> moving)
    : servo_(servo), mixer_(mixer), moving_(std::move(moving)) {
  if (moving_.size() > kMostShownMotions) moving_.resize(kMostShownMotions);
}

/// Runs between frames in their thread, so no point moves meanwhile.
void WindowFeed::answer_question() noexcept {
  if (!questions_.acquire()) return;
  const device::MixedFrame& mixed = mixer_.last();
  const render::HapticRenderer* felt = nullptr;
  if (mixed.felt < mixed.tracked.size()) felt = mixed.tracked[mixed.felt].renderer;
  if (felt != asked_) editable_ = dynamic_cast<const deformation::Editable*>(felt);
  asked_ = felt;
  PointAnswer& into = answers_.back();
  into.of = questions_.front();
  into.known = editable_ != nullptr;
  const std::size_t count = std::min<std::size_t>(into.of.count, PointQuestion::kMost);
  for (std::size_t i = 0; into.known && i < count; ++i) {
    const std::optional<Vec3> place_mm = editable_->point_position_mm(into.of.model, into.of.point[i]);
    into.known = place_mm.has_value();
    if (place_mm) into.place_mm[i] = place_mm->cast<float>();
  }
  answers_.publish();
}

void WindowFeed::took(const device::Tick& tick) noexcept {
  const std::uint64_t ticks = ticks_.load(std::memory_order_relaxed) + 1;
  WatchedTick& into = newest_.back();
  into.ticks = ticks;
  into.tick = tick;
  into.mixed = mixer_.last();
  into.map = servo_.map();
  for (std::size_t i = 0; i < moving_.size(); ++i)
    into.world_from_model[i] = moving_[i]->newest().at(tick.t_s);
  newest_.publish();
  answer_question();
  TickSample sample;
  sample.t_s = tick.t_s;
  sample.sent_n = static_cast<float>(tick.sent_n.norm());
  sample.step_us = static_cast<float>(static_cast<double>(tick.step_ns) * kUsPerNs);
  sample.contact = tick.frame.contact;
  sample.fault = tick.fault != device::Fault::kNone;
  samples_.push(sample);
  force_n_.store(sample.sent_n, std::memory_order_relaxed);
  ticks_.store(ticks, std::memory_order_release);
}

void FrameTimeHistogram::add(double us) noexcept {
  if (!(us > 0.0)) return;
  const double at = 2.0 * std::log2(us / kFirstUs);
  const double last = static_cast<double>(kBins - 1);
  ++count[static_cast<std::size_t>(std::clamp(at, 0.0, last))];
}

double FrameTimeHistogram::low_us(std::size_t bin) noexcept {
  return kFirstUs * std::exp2(0.5 * static_cast<double>(bin));
}

std::uint64_t FrameTimeHistogram::most() const noexcept {
  return *std::max_element(count.begin(), count.end());
}

void History::clear() {
  samples_.clear();
  frame_times_ = {};
}

void History::take(SampleRing& ring) {
  fresh_.clear();
  ring.drain(fresh_);
  for (const TickSample& one : fresh_) {
    samples_.push_back(one);
    frame_times_.add(static_cast<double>(one.step_us));
  }
  while (!samples_.empty() && samples_.front().t_s < samples_.back().t_s - kSeconds) samples_.pop_front();
}

double History::worst_step_us() const noexcept {
  float worst = 0.0f;
  for (const TickSample& one : samples_) worst = std::max(worst, one.step_us);
  return static_cast<double>(worst);
}

double History::mean_step_us() const noexcept {
  double sum = 0.0;
  std::size_t count = 0;
  for (const TickSample& one : samples_) {
    if (!(one.step_us > 0.0f)) continue;
    sum += static_cast<double>(one.step_us);
    ++count;
  }
  return count > 0 ? sum / static_cast<double>(count) : 0.0;
}

}  // namespace palpate::experiments
