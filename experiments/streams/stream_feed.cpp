#include "experiments/streams/stream_feed.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/options.h>
#include "toolkit/core/messages.h"

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

}  // namespace palpate::experiments
