// The work bound that each renderer of ours states, as instructions, against the longest frames that it could
// be brought to. PALPATE_FULL_BOUND=1 also counts at a hundred times the points, which prepare for an hour.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "tests/toolkit/messages.h"
#include "toolkit/core/instruction_counter.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

constexpr double kCountLimitS = 900.0, kFullLimitS = 2.0 * 3600.0;
/// Callgrind prepares fifty times as slowly; the written bound does not grow with the points.
constexpr const char* kSmall = "1000";
constexpr const char* kLarge = "300000";
/// A frame that is thrown at a renderer on purpose takes more than one that touches nothing, some 200.
constexpr double kIdleFrame = 1000.0;
/// The longest frames of one renderer at two sizes differ by what lies around each: at most so much. Work
/// that grew with the points would differ by their ratio, a hundred.
constexpr double kMostGrowth = 5.0;

struct Counted {
  std::string renderer, scene;
  double points = 0.0, frame = 0.0, bound = 0.0, instructions = 0.0;
};

/// The program calls a frame "RENDERER SCENE POINTS FRAME BOUND".
std::vector<Counted> count(const char* points, double limit_s) {
  std::vector<Counted> all;
  const auto parts = count_instructions({PALPATE_WORST_FRAMES, points}, {.time_limit_s = limit_s});
  if (!parts) {
    ADD_FAILURE() << parts.error().message();
    return all;
  }
  for (const auto& [part, instructions] : *parts) {
    std::istringstream words(part);
    Counted& one = all.emplace_back();
    one.instructions = static_cast<double>(instructions);
    EXPECT_TRUE(words >> one.renderer >> one.scene >> one.points >> one.frame >> one.bound) << part;
  }
  return all;
}

TEST(WorstFrames, AreWithinTheWrittenBound) {
  if (const Status able = can_count_instructions(); !able) GTEST_SKIP() << able.error().message();
  if (!std::filesystem::exists(PALPATE_WORST_FRAMES)) GTEST_SKIP() << "built without the benchmarks";
#ifndef NDEBUG
  GTEST_SKIP() << "the counts are those of release builds";
#endif
  const bool full = std::getenv("PALPATE_FULL_BOUND") != nullptr;
  std::vector<Counted> all = count(kSmall, kCountLimitS);
  if (full)
    for (const Counted& one : count(kLarge, kFullLimitS)) all.push_back(one);
  std::map<std::string, std::map<double, double>> worst;  // by renderer and points
  std::map<std::string, double> bound;
  for (const Counted& one : all) {
    EXPECT_LE(one.instructions, one.bound) << one.renderer << " on " << one.scene << ", frame " << one.frame;
    double& most = worst[one.renderer][one.points];
    most = std::max(most, one.instructions);
    bound[one.renderer] = one.bound;
  }
  EXPECT_EQ(worst.size(), 3u) << "the renderers of ours";
  for (const auto& [renderer, by_points] : worst) {
    for (const auto& [points, most] : by_points) {
      EXPECT_GT(most, kIdleFrame) << renderer << ": nothing was counted";
      std::cout << fmt::format("{} at {:.0f} points: {:.0f} instructions of at most {:.0f}\n", renderer,
                               points, most, bound[renderer]);
    }
    if (by_points.size() > 1) {
      EXPECT_LE(by_points.rbegin()->second, kMostGrowth * by_points.begin()->second) << renderer;
    }
  }
}

TEST(WorstFrames, TheProgramSaysWhatItTakes) {
  if (!std::filesystem::exists(PALPATE_WORST_FRAMES)) GTEST_SKIP() << "built without the benchmarks";
  for (const char* word : {"mesh-godobject", "12", "--steps"}) {
    const auto run =
        test::value_of(run_process({PALPATE_WORST_FRAMES, word}, {.time_limit_s = kCountLimitS}));
    EXPECT_EQ(run.exit_code, 2) << word;
    EXPECT_NE(run.err.find("usage"), std::string::npos) << run.err;
  }
}

}  // namespace
}  // namespace palpate::experiments
