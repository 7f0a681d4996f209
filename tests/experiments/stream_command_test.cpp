// Streams of depth images in the commands: compared, felt live, recorded, described.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>

#include <palpate/trace.h>
#include "device/record/recording.h"
#include "experiments/streams/stream_feed.h"
#include "tests/experiments/program.h"
#include "tests/json_schema.h"
#include "tests/toolkit/messages.h"
#include "tests/toolkit/stream/stream_files.h"

namespace palpate::experiments {
namespace {

using nlohmann::json;

// A quarter of the image each way: a frame takes a sixteenth of the time.
constexpr const char* kSmallWall = "sim:wall:width=160:height=120";
constexpr const char* kIdealWall = "sim:wall:width=160:height=120:sensor=ideal";

class Streams : public OnCommandLine {
 protected:
  [[nodiscard]] json result(const std::string& folder) const { return json_in(folder + "/result.json"); }
  /// A folder in Open3D's layout: a plane at 800 mm, nearer by 1 mm an image.
  void write_folder(int images) const {
    std::filesystem::create_directories(in("room/depth"));
    write_text(in("room/camera.json"),
               R"({"width": 64, "height": 48, "intrinsic_matrix": [60, 0, 0, 0, 60, 0, 31.5, 23.5, 1]})");
    for (int i = 0; i < images; ++i) {
      stream::DepthImage image{64, 48,
                               std::vector<std::uint16_t>(64 * 48, static_cast<std::uint16_t>(800 - i))};
      image.counts[0] = 0;
      write_text(in(fmt::format("room/depth/{:05}.png", i)), test::png_of(image));
    }
  }
};

TEST_F(Streams, AWallIsComparedWithItsFormulaAndIsTheSameTwice) {
  const Words few = words("--renderers depth-image --path press-and-slide:frames=1200");
  succeeds("compare --stream", kIdealWall, few, "--out @/out");
  expect_valid("result", text_in("out/result.json"));
  const json first = result("out")["renderers"][0];
  EXPECT_EQ(first["status"], "ok") << first["reason"];
  EXPECT_EQ(first["accuracy"]["reference"], "analytic");
  EXPECT_GT(first["accuracy"]["contact_frames"], 500);
  const json& stream = first["stream"];
  EXPECT_GE(stream["taken"], 34) << "1.2 s at 30 Hz";
  EXPECT_EQ(stream["taken"], stream["frames"]);
  EXPECT_GT(stream["swaps_in_contact"], 10);
  EXPECT_EQ(first["accuracy"]["lost"], 0);
  EXPECT_EQ(first["accuracy"]["fall_throughs"], 0);
  EXPECT_LT(stream["swap_step_max_n"], 0.0275) << "a still wall without noise";
  EXPECT_LT(first["accuracy"]["force_rms_percent"], 5.0);
  succeeds("compare --stream", kIdealWall, few, "--out @/again");
  EXPECT_EQ(result("again")["renderers"][0]["trace_hash"], first["trace_hash"]);
}

TEST_F(Streams, ASceneOfOnesOwnIsSeenAndItsFormulasAreTheTruth) {
  write_text(in("my.toml"), "[[model]]\ngenerate = \"ellipsoid\"\npoints = 5000\n");
  succeeds("compare --stream", "sim:" + in("my.toml") + ":width=160:height=120:sensor=ideal",
           "--renderers depth-image --path press-and-slide:frames=600 --out @/out");
  const json first = result("out")["renderers"][0];
  EXPECT_EQ(first["accuracy"]["reference"], "analytic") << first["reason"];
  EXPECT_GT(first["accuracy"]["contact_frames"], 100);
}

TEST_F(Streams, ARendererWithoutAReceiverFallsShort) {
  const ProcessOutcome run = palpate("compare --stream", kSmallWall,
                                     "--renderers cloud --path press-and-slide:frames=50 --out @/out");
  EXPECT_NE(run.exit_code, 0);
  EXPECT_THAT(run.err, HasSubstr("depth images"));
}

TEST_F(Streams, ALiveSessionRecordsBothStreamsAndTheirReplayIsTheSame) {
  succeeds("live --stream", kSmallWall, "--seconds 1.5 --accelerated --record @/both.palrec --out @/live");
  expect_valid("live", text_in("live/live.json"));
  const json live = json_in("live/live.json");
  EXPECT_EQ(live["renderers"][0]["name"], "depth-image");
  EXPECT_GE(live["stream"]["taken"], 43);
  EXPECT_EQ(live["stream"]["skipped"], 0);
  EXPECT_GT(live["renderers"][0]["swaps"], 40);
  succeeds(
      "compare --stream @/both.palrec --path @/both.palrec --stream-delay 0 --renderers depth-image "
      "--out @/replay");
  const auto replayed = value_of(trace::read_trace_csv(in("replay/trace.csv")));
  auto recording = value_of(device::Recording::open(in("both.palrec")));
  device::RecordedTick tick;
  std::size_t at = 0, compared = 0, contact = 0;
  while (recording.next(tick).value()) {
    const device::RecordedTrack& track = tick.tracks[0];
    if (!track.stepped) continue;
    while (at < replayed.path.size() && replayed.path.t_s[at] < tick.t_s) ++at;
    if (at == replayed.path.size() || replayed.path.t_s[at] != tick.t_s) continue;
    EXPECT_EQ(replayed.trace.frames[at].force_n, track.frame.force_n) << "at " << tick.t_s;
    ++compared;
    contact += track.frame.contact ? 1u : 0u;
    if (HasFailure()) break;
  }
  EXPECT_GT(compared, 1400u);
  EXPECT_GT(contact, 100u);
  EXPECT_EQ(recording.end().depth_images, live["stream"]["frames"].get<std::uint64_t>() + 1)
      << "and the camera";
  const json info = json::parse(succeeds("info @/both.palrec --json").out);
  EXPECT_EQ(info["stream"]["width"], 160);
  EXPECT_EQ(info["format"], "palrec 2");
}

TEST_F(Streams, InRealTimeNobodyWaitsForAnybody) {
  const ProcessOutcome run = palpate("live --stream", kSmallWall, "--seconds 1 --out @/live");
  ASSERT_TRUE(ended_well(run.exit_code, in("live/live.json"))) << run.err;
  const json live = json_in("live/live.json");
  EXPECT_GT(live["ticks"], 500);
  EXPECT_GT(live["stream"]["taken"], 5);
  EXPECT_TRUE(live["stream"]["light_to_touch_p50_ms"].is_number());
}

TEST_F(Streams, ASourceSlowerThanItsImagesIsStillFelt) {
  // An image takes longer to make than its period of 2 ms: left out when late, none would be felt but the
  // first.
  const ProcessOutcome run =
      palpate("live --stream sim:wall:width=160:height=120:rate_hz=500 --seconds 2 --out @/live");
  ASSERT_TRUE(ended_well(run.exit_code, in("live/live.json"))) << run.err;
  EXPECT_GT(json_in("live/live.json")["stream"]["taken"], 2);
}

TEST_F(Streams, InfoTellsRateSizeHolesAndNoise) {
  write_folder(8);
  const ProcessOutcome folder = succeeds("info", in("room"), "--json");
  expect_valid("info", folder.out);
  const json info = json::parse(folder.out);
  EXPECT_EQ(info["frames"], 8);
  EXPECT_EQ(info["width"], 64);
  EXPECT_NEAR(info["rate_hz"].get<double>(), 30.0, 0.1);
  EXPECT_NEAR(info["holes_percent"].get<double>(), 100.0 / (64 * 48), 1e-6);
  EXPECT_EQ(info["farthest_mm"], 800.0);
  const ProcessOutcome wall = succeeds("info", kSmallWall);
  EXPECT_THAT(wall.out, HasAll("160 x 120", "holes", "noise", "rate"));
}

TEST_F(Streams, BadSourcesAndOptionsAreRefusedWithARemedy) {
  std::filesystem::create_directories(in("empty"));
  write_text(in("plain.txt"), "1 2 3\n");
  for (const auto& [line, says] :
       {std::pair{"compare --stream @/nowhere --out @/o", "nowhere"},
        {"compare --stream @/empty --out @/o", "empty"},
        {"compare --stream @/plain.txt --out @/o", "plain.txt"},
        {"compare --stream sim:nothing --out @/o", "nothing"},
        {"compare --out @/o", "--stream"},
        {"compare sinusoid:points=2601 --stream sim:wall --out @/o", "exclude"},
        {"compare sinusoid:points=2601 --stream-delay 3 --out @/o", "--stream-delay"},
        {"compare --stream sim:wall --stream-delay soon --out @/o", "measured"},
        {"compare --stream sim:wall --unit m --out @/o", "--unit"},
        {"live --stream sim:wall --scale 2 --out @/o", "--scale"},
        {"compare --stream sim:wall:width=160:height=120 --reference closest-point --out @/o", "auto"},
        {"live --stream @/nowhere --out @/o", "nowhere"},
        {"live --stream sim:wall --changes 1:depth-image:stiffness=1 --out @/o", "--changes"},
        {"live --stream sim:wall --hand press --out @/o", "--hand press"},
        {"info @/empty", "empty"},
        {"info sim:nothing", "nothing"}})
    refuses(says, line);
}

}  // namespace

// Streams of depth images in a replay: when each is given, what a swap scores, and the hand before the
// camera.

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
