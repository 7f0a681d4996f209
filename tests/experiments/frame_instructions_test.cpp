// Instructions of a frame, renderer by renderer, against what stands in frame_instructions.txt: a guard that
// no load of the machine can fool. PALPATE_WRITE_INSTRUCTIONS=1 writes the file anew.
#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>

#include <palpate/options.h>
#include "toolkit/core/instruction_counter.h"

namespace palpate::experiments {
namespace {

constexpr double kCountLimitS = 300.0;
// Built by the compiler that the file was written with, a count differs only by what the libraries of the
// system bring (memory functions, mathematics): 1 %. Another compiler schedules, inlines and vectorises
// otherwise; by how much was not measured, and half as much again only catches gross mistakes.
constexpr double kSameCompiler = 0.01, kOtherCompiler = 0.5;

std::string compiler_name() {
#if defined(__clang__)
  return fmt::format("clang {}.{}", __clang_major__, __clang_minor__);
#else
  return fmt::format("gcc {}.{}", __GNUC__, __GNUC_MINOR__);
#endif
}

struct Counts {
  std::string compiler;
  std::map<std::string, double> by_renderer;  ///< instructions a frame
};

Counts read_counts(const std::string& file) {
  Counts counts;
  std::ifstream lines(file);
  for (std::string line; std::getline(lines, line);) {
    if (line.empty() || line.front() == '#') continue;
    const std::size_t at = line.rfind(' ');
    if (line.starts_with("compiler "))
      counts.compiler = line.substr(std::string("compiler ").size());
    else
      counts.by_renderer[line.substr(0, at)] = parse_number(line.substr(at + 1)).value();
  }
  return counts;
}

/// The program marks each renderer's frames as "NAME FRAMES".
Counts count() {
  Counts counts{compiler_name(), {}};
  const auto parts = count_instructions({PALPATE_FRAME_INSTRUCTIONS}, {.time_limit_s = kCountLimitS});
  if (!parts) {
    ADD_FAILURE() << parts.error().message();
    return counts;
  }
  for (const auto& [part, instructions] : *parts) {
    const std::size_t at = part.rfind(' ');
    counts.by_renderer[part.substr(0, at)] =
        static_cast<double>(instructions) / parse_number(part.substr(at + 1)).value();
  }
  return counts;
}

TEST(FrameInstructions, AreNoMoreThanTheFileSays) {
  if (const Status able = can_count_instructions(); !able) GTEST_SKIP() << able.error().message();
  if (!std::filesystem::exists(PALPATE_FRAME_INSTRUCTIONS)) GTEST_SKIP() << "built without the benchmarks";
#ifndef NDEBUG
  GTEST_SKIP() << "the counts are those of release builds";
#endif
  const Counts now = count();
  if (std::getenv("PALPATE_WRITE_INSTRUCTIONS") != nullptr) {
    std::ofstream file(PALPATE_INSTRUCTIONS_FILE);
    file << "# Instructions of a frame on the scene of experiments/benchmarks/frame_instructions.cpp, by "
            "callgrind.\n"
            "# PALPATE_WRITE_INSTRUCTIONS=1 with the test of this name writes it anew.\n"
         << "compiler " << now.compiler << "\n";
    for (const auto& [name, instructions] : now.by_renderer)
      file << fmt::format("{} {:.2f}\n", name, instructions);
    GTEST_SKIP() << "written: " << PALPATE_INSTRUCTIONS_FILE;
  }
  const Counts file = read_counts(PALPATE_INSTRUCTIONS_FILE);
  ASSERT_EQ(file.by_renderer.size(), now.by_renderer.size()) << "write the file anew";
  const double tolerance = file.compiler == now.compiler ? kSameCompiler : kOtherCompiler;
  for (const auto& [name, instructions] : now.by_renderer) {
    ASSERT_TRUE(file.by_renderer.contains(name)) << name;
    const double before = file.by_renderer.at(name);
    EXPECT_LE(instructions, before * (1.0 + tolerance))
        << name << ": a frame takes " << 100.0 * (instructions / before - 1.0)
        << " % more instructions than with " << file.compiler << "; where that is meant, write the file anew";
    if (instructions < before * (1.0 - tolerance))
      std::cout << name << ": " << before << " -> " << instructions
                << " instructions a frame: better; write the file anew, so that it stays so\n";
  }
}

}  // namespace
}  // namespace palpate::experiments
