// What a scene does not ask for costs nothing: for every renderer of ours the instructions of a frame,
// counted by callgrind, and the bytes, as the renderer reports them and as the allocator counts them.
#include <gtest/gtest.h>

#include <filesystem>
#include <map>
#include <set>
#include <sstream>

#include <palpate/registry.h>
#include "toolkit/core/instruction_counter.h"
#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

constexpr double kLimitS = 600.0;

struct Cost {
  std::string kind;
  std::uint64_t instructions = 0, reported = 0, heap = 0;
};
/// By "FEATURE KIND"; a feature may be there twice, asked for and declined.
using Costs = std::map<std::string, Cost>;

std::map<std::string, Costs> all_costs() {
  const Result<ProcessOutcome> run = run_process({PALPATE_FEATURE_COST}, {.time_limit_s = kLimitS});
  std::map<std::string, Costs> costs;
  if (!run || run->exit_code != 0) {
    ADD_FAILURE() << (run ? run->err : run.error().message());
    return costs;
  }
  std::istringstream lines(run->out);
  std::string renderer, feature;
  for (Cost cost;
       lines >> renderer >> feature >> cost.kind >> cost.instructions >> cost.reported >> cost.heap;)
    costs[renderer][feature + " " + cost.kind] = cost;
  return costs;
}

TEST(FeatureCost, WhatIsNotAskedForCostsNoInstructionAndNoByte) {
  if (const Status able = can_count_instructions(); !able) GTEST_SKIP() << able.error().message();
  if (!std::filesystem::exists(PALPATE_FEATURE_COST)) GTEST_SKIP() << "built without the benchmarks";
  const std::map<std::string, Costs> all = all_costs();
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  for (const render::RendererInfo& info : registry.all()) {
    if (info.role != render::Role::kOurs && info.role != render::Role::kLiteral) continue;
    if (info.geometry == render::Geometry::kImages) continue;
    EXPECT_TRUE(all.contains(info.name)) << info.name;
  }
  for (const auto& [renderer, costs] : all) {
    ASSERT_TRUE(costs.contains("bare bare")) << renderer;
    const Cost& bare = costs.at("bare bare");
    std::set<std::string> asked;
    for (const auto& [name, cost] : costs) {
      SCOPED_TRACE(renderer + ", " + name);
      if (cost.kind == "on") {
        // It is really there: else its absence would prove nothing.
        EXPECT_GT(cost.instructions, bare.instructions);
        asked.insert(name);
      } else {  // declined, or asked of a renderer that lacks it
        EXPECT_EQ(cost.instructions, bare.instructions);
        EXPECT_EQ(cost.reported, bare.reported);
        EXPECT_EQ(cost.heap, bare.heap);
      }
    }
    constexpr std::size_t kLeastAsked = 8;
    EXPECT_GE(asked.size(), kLeastAsked) << renderer << ": features are missing from the program";
    // What is one number for all points takes no byte.
    for (const char* uniform : {"friction on", "texture on", "force-limit on"}) {
      const auto found = costs.find(uniform);
      if (found == costs.end()) continue;
      EXPECT_EQ(found->second.reported, bare.reported) << renderer << " " << uniform;
    }
  }
}

}  // namespace
}  // namespace palpate::experiments
