// The work bound that each renderer of ours states, as instructions, against the longest frames that it could
// be brought to. PALPATE_FULL_BOUND=1 also counts at ten million points, which takes an hour.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "toolkit/core/instructions.h"

namespace palpate::experiments {
namespace {

constexpr double kCountLimitS = 900.0, kFullLimitS = 4.0 * 3600.0;
constexpr const char* kSmall = "10000";
constexpr const char* kLarge = "10000000";
/// A frame that is thrown at a renderer on purpose takes more than one that touches nothing, some 200.
constexpr double kIdleFrame = 1000.0;
/// The longest frames of one renderer at two sizes differ by what lies around each: at most so much. Work
/// that grew with the points would differ by their ratio, a thousand.
constexpr double kMostGrowth = 5.0;

struct Counted {
  std::string renderer, scene;
  double points = 0.0, frame = 0.0, bound = 0.0, instructions = 0.0;
};

/// The program marks each frame as "RENDERER SCENE POINTS FRAME BOUND".
std::vector<Counted> count(const std::vector<std::string>& sizes, double limit_s) {
  std::vector<std::string> command = {PALPATE_WORST_FRAMES};
  command.insert(command.end(), sizes.begin(), sizes.end());
  std::vector<Counted> all;
  const auto parts = count_instructions(command, {.time_limit_s = limit_s});
  if (!parts) {
    ADD_FAILURE() << parts.error().message();
    return all;
  }
  for (const auto& [part, instructions] : *parts) {
    std::istringstream words(part);
    Counted one;
    EXPECT_TRUE(words >> one.renderer >> one.scene >> one.points >> one.frame >> one.bound) << part;
    one.instructions = static_cast<double>(instructions);
    all.push_back(one);
  }
  return all;
}

TEST(WorstFrames, AreWithinTheWrittenBound) {
  if (const Status able = can_count(); !able) GTEST_SKIP() << able.error().message();
  if (!std::filesystem::exists(PALPATE_WORST_FRAMES)) GTEST_SKIP() << "built without the benchmarks";
#ifndef NDEBUG
  GTEST_SKIP() << "the counts are those of release builds";
#endif
  const bool full = std::getenv("PALPATE_FULL_BOUND") != nullptr;
  std::vector<std::string> sizes = {kSmall};
  if (full) sizes.emplace_back(kLarge);
  const std::vector<Counted> all = count(sizes, full ? kFullLimitS : kCountLimitS);
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

}  // namespace
}  // namespace palpate::experiments
