// Streams of depth images in a replay: when each is given, what a swap scores, and the hand before the
// camera.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "experiments/streams/stream_feed.h"
#include "tests/toolkit/messages.h"

namespace palpate::experiments {
namespace {

TEST(PressAndSlide, TheHandFollowsASwingingWallAndKeepsItsSpeed) {
  HandView view;
  view.nearest_mm = view.median_mm = view.farthest_mm = 1000.0;
  view.half_width_mm = 600.0;
  view.half_height_mm = 450.0;
  constexpr double kStiffness = 0.5, kSwingMm = 50.0;
  const auto options = test::value_of(parse_press_and_slide("press-and-slide:frames=6000"));
  trace::ProbePath path;
  std::size_t contact = 0;
  press_and_slide(
      view, kStiffness, options,
      [&](const Vec3& hip_mm, double t_s) -> Vec3 {
        const double wall_mm = 1000.0 + kSwingMm * std::sin(2.0 * std::numbers::pi * t_s);
        contact += hip_mm.z() > wall_mm ? 1u : 0u;
        return {0.0, 0.0, std::min(0.0, kStiffness * (wall_mm - hip_mm.z()))};
      },
      path);
  ASSERT_EQ(path.size(), 6000u);
  EXPECT_GT(contact, 4000u) << "it presses two thirds of the time, and lifts in between";
  EXPECT_LT(contact, 6000u);
  double fastest_mm = 0.0;
  for (std::size_t i = 1; i < path.size(); ++i)
    fastest_mm = std::max(fastest_mm, (path.hip_mm[i] - path.hip_mm[i - 1]).norm());
  EXPECT_LE(fastest_mm, 0.5 * (1.0 + 1e-9)) << "half a metre a second at 1 m";
  EXPECT_GT(fastest_mm, 0.4);
}

/// Notes which frames it was given, when the HIP was where.
class Noted final : public stream::DepthReceiver {
 public:
  [[nodiscard]] stream::ReceiveReport receive(const stream::DepthFrame& frame,
                                              const Vec3& hip_mm) noexcept override {
    given.emplace_back(frame.number, hip_mm.x());
    return {stream::FrameFate::kTaken, window_ms, whole_ms};
  }
  void forget_frames() noexcept override { given.clear(); }
  std::vector<std::pair<std::uint64_t, double>> given;
  double window_ms = 0.0, whole_ms = 0.0;
};

class Feed : public testing::Test {
 protected:
  Feed() {
    for (int i = 0; i < 100; ++i) {
      path_.t_s.push_back(i * 1e-3);
      path_.hip_mm.emplace_back(i, 0.0, 0.0);
    }
    for (int i = 0; i < 4; ++i) {
      stream::DepthFrame frame;
      frame.number = static_cast<std::uint64_t>(i);
      frame.captured_s = i * 0.02;
      frame.arrived_s = frame.captured_s + 0.01;
      stream_.frames.push_back(frame);
    }
  }
  void pass(StreamFeed& feed) const {
    feed.reset();
    for (const double t_s : path_.t_s) feed.advance(t_s);
  }
  trace::ProbePath path_;
  StreamFrames stream_;
  Noted receiver_;
};

TEST_F(Feed, GivesEachImageAtItsTimeWithTheLastHipBefore) {
  StreamFeed feed(stream_, receiver_, path_, {4.5, false});
  for (int turn = 0; turn < 2; ++turn) {
    pass(feed);
    // Due 10 + 4.5 ms: the tick at 15 ms feels it, and the one at 14 ms was the last before.
    const std::vector<std::pair<std::uint64_t, double>> expected = {
        {0, 14.0}, {1, 34.0}, {2, 54.0}, {3, 74.0}};
    EXPECT_EQ(receiver_.given, expected);
  }
  EXPECT_EQ(feed.skipped(), 0u);
}

TEST_F(Feed, AMeasuredDelaySkipsWhatABusyReceiverMisses) {
  receiver_.window_ms = 5.0;
  receiver_.whole_ms = 45.0;
  StreamFeed feed(stream_, receiver_, path_, {0.0, true});
  for (int turn = 0; turn < 2; ++turn) {
    pass(feed);
    // Busy from 10 to 55 ms: image 2, which came at 50 ms, overtakes image 1.
    const std::vector<metrics::StreamDelivery> given = feed.deliveries();
    ASSERT_EQ(given.size(), 2u);
    EXPECT_EQ(given[0].frame, 0u);
    EXPECT_EQ(given[1].frame, 2u);
    EXPECT_NEAR(given[1].due_s, 0.060, 1e-9) << "free at 55 ms, and 5 ms for the window";
    EXPECT_EQ(feed.skipped(), 1u);
  }
}

TEST(StreamScores, AStepAtASwapIsWhatTheHandDidNotMake) {
  trace::ProbePath path;
  trace::ForceTrace trace;
  for (int i = 0; i < 10; ++i) {
    path.t_s.push_back(i * 1e-3);
    path.hip_mm.emplace_back(0.0, 0.0, -0.1 * i);
    render::Frame frame;
    frame.contact = i > 0;
    frame.force_n = {0.0, 0.0, 0.05 * i + (i >= 5 ? 0.2 : 0.0)};
    trace.frames.push_back(frame);
  }
  const std::vector<metrics::StreamDelivery> given = {
      {0, 0.0, 0.0045, {stream::FrameFate::kTaken, 1.0, 2.0}},
      {1, 0.002, 0.0065, {stream::FrameFate::kRepeated, 0.0, 0.0}},
      {2, 0.004, 0.0075, {stream::FrameFate::kTaken, 3.0, 4.0}},
      {3, 0.006, 1.0, {stream::FrameFate::kTaken, 3.0, 4.0}}};
  const metrics::StreamScores scores = metrics::score_stream(path, trace, given, 0.5);
  EXPECT_EQ(scores.frames, 3u) << "the last is due after the path";
  EXPECT_EQ(scores.taken, 2u);
  EXPECT_EQ(scores.repeated, 1u);
  EXPECT_EQ(scores.swaps_in_contact, 2u);
  EXPECT_EQ(scores.releases, 0u);
  EXPECT_NEAR(*scores.swap_step_max_n, 0.2, 1e-12);
  EXPECT_NEAR(*scores.rate_max_n_per_ms, 0.2, 1e-9);
  EXPECT_NEAR(*scores.light_to_tick_p99_ms, 5.0, 1e-9);
  EXPECT_EQ(*scores.window_p99_ms, 3.0);
  // Contact that a swap drops is a step as well.
  for (std::size_t i = 8; i < trace.frames.size(); ++i) trace.frames[i] = {};
  const metrics::StreamScores dropped = metrics::score_stream(path, trace, given, 0.5);
  EXPECT_EQ(dropped.releases, 1u);
  EXPECT_NEAR(*dropped.swap_step_max_n, 0.05 * 7 + 0.2 - 0.05, 1e-12);
}

}  // namespace
}  // namespace palpate::experiments
