// What a scene does not ask for costs nothing: instructions of a frame, counted by callgrind, which counts
// the same on every run.
#include <gtest/gtest.h>

#include <filesystem>
#include <regex>

#include "toolkit/core/process.h"

namespace palpate::experiments {
namespace {

constexpr double kLimitS = 120.0;

/// Instructions of a whole run, or -1.
long long counted(const std::string& features, const std::string& repeats) {
  const Result<ProcessOutcome> run =
      run_process({"valgrind", "--tool=callgrind", "--callgrind-out-file=/dev/null", PALPATE_FEATURE_COST,
                   features, repeats},
                  {.time_limit_s = kLimitS});
  std::smatch found;
  if (!run || run->exit_code != 0 ||
      !std::regex_search(run->err, found, std::regex("Collected : ([0-9]+)"))) {
    ADD_FAILURE() << (run ? run->err : run.error().message());
    return -1;
  }
  return std::stoll(found[1]);
}

/// Of the path's frames alone: one run steps them once more than the other.
long long frames_of(const std::string& features) {
  return counted(features, "2") - counted(features, "1");
}

TEST(FeatureCost, WhatIsNotAskedForCostsNoInstruction) {
  if (!program_exists("valgrind")) GTEST_SKIP() << "valgrind is not installed: apt-get install valgrind";
  if (!std::filesystem::exists(PALPATE_FEATURE_COST)) GTEST_SKIP() << "built without the benchmarks";
  const long long bare = frames_of("bare");
  // A few instructions of the start-up (the environment's length) are all that may differ.
  constexpr long long kStartUp = 100;
  EXPECT_NEAR(static_cast<double>(frames_of("soft")), static_cast<double>(bare), kStartUp)
      << "deformation that is the same everywhere is a softer spring";
  const long long friction = frames_of("friction") - bare, texture = frames_of("texture") - bare;
  const long long both = frames_of("friction+texture") - bare;
  EXPECT_GT(friction, 4500 * 10) << "friction is really in the frame";
  EXPECT_GT(texture, friction) << "noise costs more than a cone";
  // Together they cost what they cost alone: neither drags the other in.
  EXPECT_LT(static_cast<double>(both), 1.1 * static_cast<double>(friction + texture));
}

}  // namespace
}  // namespace palpate::experiments
