// Measures detection and motor release for every fault between renderer and motors, over many runs on the
// simulated link. See docs/results/hands-and-loops.md.
//
//   fault_table [--runs N] [--virtual] [--json FILE]
//
// Virtual-clock figures (--virtual) are equal on every machine. Real-clock figures include the scheduler and
// killed processes.
#include <fmt/format.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <cstdlib>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include <palpate/device/scheduling.h>
#include "experiments/benchmarks/fault_trial.h"
#include "toolkit/core/files.h"

namespace palpate::device {
namespace {

using Json = nlohmann::ordered_json;

constexpr double kRates[] = {1000.0, 4000.0};
constexpr int kMostFrames = 2;  // from detection to zero
constexpr double kDeathPatienceS = 10.0;
constexpr double kKillAfterS = 0.050;  // the guard's, for a stopped program
constexpr double kFeltN = 0.9;         // of 1 N, for harmless faults
constexpr int kMostTries = 5;          // for a valid run

struct Asked {
  int runs = 20;
  bool on_virtual = false;
  std::string json;
};

struct Line {
  std::string fault{};
  double rate_hz = 0.0;
  int runs = 0, right = 0, void_runs = 0;
  bool harmless = false;
  std::map<std::string, int> seen_as{};
  std::vector<double> detect_ms{}, zero_ms{};
  int frames = 0;
};

double at_share(std::vector<double> values, double share) {
  if (values.empty()) return -1.0;
  std::sort(values.begin(), values.end());
  return values[static_cast<std::size_t>(share * static_cast<double>(values.size() - 1) + 0.5)];
}

void add(Line& line, const TrialOutcome& outcome) {
  ++line.runs;
  ++line.seen_as[fault_name(outcome.fault)];
  line.frames = std::max(line.frames, outcome.frames_to_zero);
  if (line.harmless) {
    if (outcome.fault == Fault::kNone && outcome.force_at_end_n > kFeltN) ++line.right;
    return;
  }
  if (outcome.fault == Fault::kNone) return;
  line.detect_ms.push_back(outcome.detected_ms);
  if (outcome.force_at_end_n != 0.0) return;
  line.zero_ms.push_back(outcome.zero_ms);
  if (outcome.frames_to_zero <= kMostFrames) ++line.right;
}

Result<Line> fault_line(const TrialFault& fault, double rate_hz, const Asked& asked) {
  Line line{.fault = fault.name, .rate_hz = rate_hz, .harmless = fault.harmless};
  for (int run = 0; line.runs < asked.runs && run < kMostTries * asked.runs; ++run) {
    const auto seed = static_cast<std::uint64_t>(run + 1);
    const Result<TrialOutcome> outcome = run_trial(fault, {rate_hz, seed, !asked.on_virtual});
    if (!outcome) return outcome.error();
    if (outcome->force_before_n > kFeltN)
      add(line, *outcome);
    else
      ++line.void_runs;
  }
  return line;
}

Result<Line> death_line(const char* name, int signal, double rate_hz, const Asked& asked) {
  Line line{.fault = name, .rate_hz = rate_hz};
  PressOptions options{.rate_hz = rate_hz};
  if (signal == SIGSTOP) options.guard.kill_after_s = kKillAfterS;
  for (int run = 0; run < asked.runs; ++run) {
    const Result<DeathOutcome> outcome = run_death(signal, options, kDeathPatienceS);
    if (!outcome) return outcome.error();
    ++line.runs;
    ++line.seen_as["the guard process"];
    if (!outcome->pressed || outcome->zero_ms < 0.0) continue;
    line.zero_ms.push_back(outcome->zero_ms);
    ++line.right;
  }
  return line;
}

std::string names_of(const Line& line) {
  std::string all;
  for (const auto& [name, times] : line.seen_as) {
    if (!all.empty()) all += ", ";
    all += line.seen_as.size() == 1 ? name : fmt::format("{} ({})", name, times);
  }
  return line.harmless && all == "none" ? "felt through" : all;
}

std::string ms_of(const std::vector<double>& values) {
  if (values.empty()) return "-";
  return fmt::format("{:.1f} / {:.1f}", at_share(values, 0.5), at_share(values, 1.0));
}

void print(const Line& line) {
  fmt::print("| {} | {:.0f} kHz | {} | {} | {} | {} | {:.0f} % of {} |\n", line.fault, line.rate_hz / 1e3,
             names_of(line), ms_of(line.detect_ms), ms_of(line.zero_ms), line.frames,
             100.0 * line.right / std::max(1, line.runs), line.runs);
  std::fflush(stdout);
}

Json json_of(const Line& line) {
  return {{"fault", line.fault},
          {"rate_hz", line.rate_hz},
          {"runs", line.runs},
          {"right", line.right},
          {"void", line.void_runs},
          {"harmless", line.harmless},
          {"seen_as", line.seen_as},
          {"detect_ms", {{"p50", at_share(line.detect_ms, 0.5)}, {"max", at_share(line.detect_ms, 1.0)}}},
          {"zero_ms", {{"p50", at_share(line.zero_ms, 0.5)}, {"max", at_share(line.zero_ms, 1.0)}}},
          {"frames_to_zero", line.frames}};
}

Result<std::vector<Line>> all_lines(const Asked& asked) {
  struct Death {
    const char* name;
    int signal;
  };
  std::vector<Line> lines;
  const auto keep = [&](Result<Line> line) -> Status {
    if (!line) return std::move(line).error();
    print(*line);
    lines.push_back(std::move(line).value());
    return Done{};
  };
  for (const double rate_hz : kRates) {
    for (const TrialFault& fault : trial_faults())
      if (Status kept = keep(fault_line(fault, rate_hz, asked)); !kept) return kept.error();
    if (asked.on_virtual) continue;
    for (const Death& death :
         {Death{"kill -9", SIGKILL}, Death{"abort", SIGABRT}, Death{"crash (SIGSEGV)", SIGSEGV},
          Death{"stopped (SIGSTOP), killed after 50 ms", SIGSTOP}})
      if (Status kept = keep(death_line(death.name, death.signal, rate_hz, asked)); !kept)
        return kept.error();
  }
  return lines;
}

/// False, with an error message, for invalid arguments.
bool understood(const std::vector<std::string>& words, Asked& asked) {
  for (std::size_t i = 0; i < words.size(); ++i) {
    const bool more = i + 1 < words.size();
    if (words[i] == "--virtual") {
      asked.on_virtual = true;
    } else if (words[i] == "--runs" && more &&
               words[i + 1].find_first_not_of("0123456789") == std::string::npos &&
               words[i + 1].size() <= 6) {
      asked.runs = std::atoi(words[++i].c_str());
    } else if (words[i] == "--json" && more) {
      asked.json = words[++i];
    } else {
      fmt::print(stderr, "error: '{}'; usage: fault_table [--runs N] [--virtual] [--json FILE]\n", words[i]);
      return false;
    }
  }
  if (asked.runs > 0) return true;
  fmt::print(stderr, "error: --runs is {}; give 1 or more\n", asked.runs);
  return false;
}

int run(const std::vector<std::string>& words) {
  constexpr int kUsage = 2;
  Asked asked;
  if (!understood(words, asked)) return kUsage;
  fmt::print(
      "| fault | rate | seen as | detected, ms: p50 / max | zero, ms: p50 / max | frames with force after | "
      "right |\n"
      "| --- | --- | --- | ---: | ---: | ---: | ---: |\n");
  SchedulingMode mode;
  if (!asked.on_virtual) {
    enter_real_time({.pin = false}, mode);
    fmt::print(stderr, "the loop runs with {}\n", mode.text());
  }
  const Result<std::vector<Line>> lines = all_lines(asked);
  if (!lines) {
    fmt::print(stderr, "error: {}\n", lines.error().message());
    return 1;
  }
  bool right = true;
  Json rows = Json::array();
  for (const Line& line : *lines) {
    rows.push_back(json_of(line));
    right = right && line.right == line.runs && line.runs == asked.runs;
  }
  if (!asked.json.empty()) {
    const Json document = {{"clock", asked.on_virtual ? "virtual" : "real"},
                           {"scheduling", asked.on_virtual ? "" : mode.text()},
                           {"faults", rows}};
    if (const Status written = write_file(asked.json, document.dump(2) + "\n"); !written) {
      fmt::print(stderr, "error: {}\n", written.error().message());
      return kUsage;
    }
  }
  return right ? 0 : 1;
}

}  // namespace
}  // namespace palpate::device

int main(int argc, char** argv) {
  return palpate::device::run(std::vector<std::string>(argv + 1, argv + argc));
}
