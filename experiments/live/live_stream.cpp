#include "experiments/live/live.h"

#include <fmt/format.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <exception>
#include <utility>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "experiments/window/splat_points.h"

namespace palpate::experiments {
namespace {

constexpr double kStreamNsPerMs = 1e6, kStreamMsPerS = 1e3, kStreamSPerNs = 1e-9;
// A thread that waits for an arrival looks this often whether the session ends: a twentieth of the time that
// an image at 30 Hz may take until it is felt.
constexpr std::chrono::microseconds kArrivalNap{500};
// An image that takes over this share of a period to be read would gain less time by being left out than it
// took.
constexpr double kSlowToRead = 0.5;
// Files that give nothing but errors for so long are at their end.
constexpr std::uint64_t kMostUnreadableLive = 10'000;

void count_ms(device::DurationHistogram& times, double ms) noexcept {
  times.count(std::llround(ms * kStreamNsPerMs));
}

void set_ms(const device::DurationHistogram& times, std::optional<double>& p50, std::optional<double>& p99) {
  const device::DurationStatistics found = times.statistics();
  if (found.count == 0) return;
  p50 = static_cast<double>(found.p50_ns) / kStreamNsPerMs;
  p99 = static_cast<double>(found.p99_ns) / kStreamNsPerMs;
}

}  // namespace

LiveStream::LiveStream(OpenStream& open, std::vector<stream::DepthReceiver*> receivers,
                       const device::Mixer& mixer, bool accelerated, double period_s)
    : open_(open),
      receivers_(std::move(receivers)),
      mixer_(mixer),
      accelerated_(accelerated),
      period_s_(period_s) {
  facts_.source = open.name;
  facts_.about = open.source->describe();
  facts_.unreadable = open.unreadable.size();
}

LiveStream::~LiveStream() {
  end();
}

Status LiveStream::record(device::Recorder& recorder) {
  const stream::DepthCamera& camera = open_.source->camera();
  PALPATE_TRY(recorder.add_depth(stream::encode_camera(camera)));
  codec_ = std::make_unique<stream::DepthCodec>(camera);
  recorder_ = &recorder;
  return Done{};
}

std::shared_ptr<TripleBuffer<ShownImage>> LiveStream::shown() {
  rays_.emplace(open_.source->camera());
  shown_pixels_ = even_order(open_.source->camera().pixels());
  shown_ = std::make_shared<TripleBuffer<ShownImage>>();
  return shown_;
}

void LiveStream::show() {
  ShownImage& image = shown_->back();
  image.places.clear();
  image.world_from_camera = frame_.world_from_camera;
  for (const std::uint32_t pixel : shown_pixels_) {
    if (!render::is_measured(frame_.depth_mm[pixel])) continue;
    const Vec3f place = frame_.depth_mm[pixel] * rays_->ray(pixel).cast<float>();
    image.places.insert(image.places.end(), place.data(), place.data() + place.size());
  }
  shown_->publish();
}

void LiveStream::begin() {
  if (!accelerated_) thread_ = std::thread([this] { run(); });
}

void LiveStream::end() {
  ending_.store(true, std::memory_order_release);
  if (thread_.joinable()) thread_.join();
}

void LiveStream::took(const device::Tick& tick) noexcept {
  const device::MixedFrame& mixed = mixer_.last();
  StreamedHand hand;
  hand.hip_mm = tick.hip_mm;
  if (mixed.felt < mixed.tracked.size()) hand.lane = mixed.tracked[mixed.felt].lane;
  hand_.publish(hand);
  tick_s_.store(tick.t_s, std::memory_order_relaxed);
  tick_ns_.store(accelerated_ ? 0 : monotonic_ns(), std::memory_order_relaxed);
  begun_.store(true, std::memory_order_release);
}

/// The session's time. A tick between the two loads is off by a period.
double LiveStream::now_s() const {
  const double tick_s = tick_s_.load(std::memory_order_relaxed);
  return tick_s +
         static_cast<double>(monotonic_ns() - tick_ns_.load(std::memory_order_relaxed)) * kStreamSPerNs;
}

/// Errors here, such as exhausted memory, must not end the session with a hand on the device.
void LiveStream::run() {
  try {
    while (!ending_.load(std::memory_order_acquire)) {
      if (begun_.load(std::memory_order_acquire)) pump(now_s());
      std::this_thread::sleep_for(kArrivalNap);
    }
  } catch (const std::exception& problem) {
    why_ended_ = fmt::format(" ({})", problem.what());
    ended_.store(true, std::memory_order_release);
  }
}

/// Gives what has arrived by then; in real time, by now.
void LiveStream::pump(double until_s) {
  if (first_) base_s_ = tick_s_.load(std::memory_order_relaxed);
  while (!ending_.load(std::memory_order_acquire) && (has_next_ || read_next())) {
    if (!accelerated_) until_s = now_s();
    if (frame_.arrived_s > until_s) return;
    has_next_ = false;
    // When frames take longer than they come, every other one is left out.
    if (!accelerated_ && until_s - frame_.arrived_s > open_.source->camera().period_s)
      ++facts_.skipped;
    else
      give();
  }
}

/// Reads a frame, in the session's time. A camera's arrives now, whatever its clock says. A source that is
/// slow to read plays slower, since each of its frames would be left out as late.
bool LiveStream::read_next() {
  if (ended_.load(std::memory_order_relaxed)) return false;
  const double begun_s = now_s();
  if (std::exchange(first_, false)) {
    frame_ = open_.first;
  } else {
    Result<bool> more = open_.source->next(frame_);
    while (!more && ++facts_.unreadable < kMostUnreadableLive && !ending_.load(std::memory_order_acquire))
      more = open_.source->next(frame_);
    if (!more || !*more) {
      ended_.store(true, std::memory_order_release);
      return false;
    }
    open_.shift(frame_);
  }
  const double read_s = now_s(), arrives_now_s = read_s - frame_.arrived_s;
  if (open_.is_camera)
    base_s_ = arrives_now_s;
  else if (!accelerated_ && read_s - begun_s > kSlowToRead * open_.source->camera().period_s)
    base_s_ = std::max(base_s_, arrives_now_s);
  frame_.captured_s += base_s_;
  frame_.arrived_s += base_s_;
  has_next_ = true;
  return true;
}

/// The felt renderer first.
void LiveStream::give() {
  hand_.acquire();
  const StreamedHand hand = hand_.front();
  const double begun_s = accelerated_ ? frame_.arrived_s : now_s();
  const auto give_to = [&](std::size_t lane) { return receivers_[lane]->receive(frame_, hand.hip_mm); };
  const std::size_t felt = std::min(hand.lane, receivers_.size() - 1);
  const stream::ReceiveReport report = give_to(felt);
  for (std::size_t lane = 0; lane < receivers_.size(); ++lane)
    if (lane != felt && receivers_[lane] != receivers_[felt]) (void)give_to(lane);
  ++facts_.frames;
  facts_.taken += report.fate == stream::FrameFate::kTaken ? 1u : 0u;
  facts_.repeated += report.fate == stream::FrameFate::kRepeated ? 1u : 0u;
  facts_.late += report.fate == stream::FrameFate::kLate ? 1u : 0u;
  facts_.truncated += report.fate == stream::FrameFate::kTruncated ? 1u : 0u;
  facts_.failed += report.fate == stream::FrameFate::kFailed ? 1u : 0u;
  if (report.fate == stream::FrameFate::kTaken) {
    count_ms(window_, report.window_ms);
    count_ms(whole_, report.whole_ms);
    count_ms(light_, (begun_s - frame_.captured_s) * kStreamMsPerS + report.window_ms);
    if (shown_) show();
  }
  given_s_.store(begun_s, std::memory_order_relaxed);
  if (recorder_ == nullptr) return;
  const Result<std::span<const std::byte>> bytes = codec_->encode(frame_);
  // The recorder tells at its end what is missing.
  if (bytes)
    (void)recorder_->add_depth(*bytes);
  else
    ++facts_.unrecorded;
}

std::string LiveStream::work() {
  if (!begun_.load(std::memory_order_acquire)) return {};
  if (accelerated_) {
    pump(tick_s_.load(std::memory_order_relaxed) + period_s_);
    return {};
  }
  if (ended_.load(std::memory_order_acquire))
    return std::exchange(end_reported_, true)
               ? std::string()
               : fmt::format("the stream has ended{}: its last surface stays under the hand", why_ended_);
  const double still_s = now_s() - given_s_.load(std::memory_order_relaxed);
  const bool silent = still_s > kSilentPeriods * open_.source->camera().period_s;
  if (silent == silent_) return {};
  silent_ = silent;
  silences_ += silent ? 1u : 0u;
  return silent ? "the camera is silent: its last surface stays under the hand" : "the camera is back";
}

LiveStreamFacts LiveStream::facts() const {
  LiveStreamFacts facts = facts_;
  facts.silences = silences_;
  facts.ended = ended_.load(std::memory_order_acquire);
  set_ms(window_, facts.window_p50_ms, facts.window_p99_ms);
  set_ms(whole_, facts.whole_p50_ms, facts.whole_p99_ms);
  set_ms(light_, facts.light_to_touch_p50_ms, facts.light_to_touch_p99_ms);
  return facts;
}

}  // namespace palpate::experiments
