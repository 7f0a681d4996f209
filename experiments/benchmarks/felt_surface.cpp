// Scores every renderer against the exact truth on point sets outside the suite, one path per set. See
// docs/results/measured.md.
//
//   felt_surface [--sets a,b] [--renderers list] [--frames N] [--closed-paths N] [--quick] [--threads N]
//                [--seed N] [--where N] [--prepare-limit-s S] [--json FILE] [--commit ID] [--list]
//   felt_surface --slice FILE.svg [--sets edge|hole|thin|noise] [--renderers list]
//
// A set is a name from --list, or a generator with options; --seed chooses other random points and paths,
// --where lists the places with most error. Renderers use the palpate command's syntax; label=NAME names
// their rows.
#include <fmt/format.h>

#include <cstdio>
#include <exception>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include <palpate/baselines.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/benchmarks/felt_surface/trial.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::felt {
namespace {

constexpr int kBadArguments = 2;
constexpr std::size_t kFrames = 20'000, kQuickFrames = 10'000;

struct Arguments {
  std::vector<std::string> sets;
  std::vector<Tried> renderers;
  std::size_t frames = 0;  ///< 0: default
  std::uint64_t seed = 0;
  bool quick = false, list = false;
  std::string json, slice, commit = "not noted", started_utc;
  TrialOptions trial;
};

std::string number(const std::optional<double>& x) {
  return x ? fmt::format("{:.3g}", *x) : "-";
}

void print_head() {
  fmt::print(
      "{:8} {:22} {:>8} {:>8} {:>8} {:>6} {:>6} {:>6} {:>6} {:>4} {:>8} {:>8} {:>7} {:>7} {:>7} {:>7} {:>7} "
      "{:>6} "
      "{:>5}\n",
      "set", "renderer", "RMS %", "uncaught", "median N", "jumps", "missed", "false", "stick", "pops",
      "energy %", "loops %", "free N", "cont ns", "all ns", "p999 us", "prep ms", "B/pt", "bound");
}

void print_row(const Row& row) {
  if (!row.failed.empty()) {
    fmt::print("{:8} {:22} failed: {}\n", row.set, row.renderer, row.failed);
    return;
  }
  const metrics::Accuracy& a = row.accuracy;
  fmt::print(
      "{:8} {:22} {:>8} {:>8} {:>8} {:>6} {:>6} {:>6} {:>6} {:>4} {:>8} {:>8} {:>7} {:>7.1f} {:>7.1f} {:>7} "
      "{:>7.0f} "
      "{:>6.1f} {:>5}\n",
      row.set, row.renderer, number(a.force_rms_percent), number(row.uncaught_rms_percent),
      number(row.median_error_n), a.excess_jumps.value_or(0), a.missed_contact_frames, a.false_contact_frames,
      a.longest_stick_frames, a.pop_throughs ? fmt::format("{}", *a.pop_throughs) : "-",
      number(row.energy_percent), number(row.loop_energy_percent), number(row.free_force_n), row.contact_ns,
      row.all_ns, number(row.p999_us), row.prepare_ms, row.bytes_per_point, row.bound_hits);
}

void print_mistakes(const Row& row) {
  const auto place = [](const Vec3& p) {
    return fmt::format("({:.2f}, {:.2f}, {:.2f})", p.x(), p.y(), p.z());
  };
  for (const Mistake& one : row.mistakes)
    fmt::print("  frames {} to {}: {:.1f} % of the error; HIP {}, truth {}, felt {}\n", one.begin, one.end,
               100.0 * one.share, place(one.hip_mm), one.true_contact ? place(one.true_god_mm) : "free",
               one.felt_contact ? place(one.felt_god_mm) : "free");
}

template <class T>
nlohmann::ordered_json or_null(const std::optional<T>& x) {
  return x ? nlohmann::ordered_json(*x) : nlohmann::ordered_json(nullptr);
}

nlohmann::ordered_json json_of(const Row& row) {
  nlohmann::ordered_json json = {{"label", row.set + "/" + row.renderer},
                                 {"set", row.set},
                                 {"renderer", row.renderer},
                                 {"points", row.points},
                                 {"spacing_mm", row.spacing_mm},
                                 {"status", row.failed.empty() ? "ok" : "failed"}};
  if (!row.failed.empty()) {
    json["reason"] = row.failed;
    json["summary"] = json["times"] = json["errors"] = "fails";
    return json;
  }
  const metrics::Accuracy& a = row.accuracy;
  json["contact_frames"] = a.contact_frames;
  json["force_rms_percent"] = or_null(a.force_rms_percent);
  json["force_rms_n"] = or_null(a.force_rms_n);
  json["force_max_n"] = or_null(a.force_max_n);
  json["median_error_n"] = or_null(row.median_error_n);
  json["uncaught_rms_percent"] = or_null(row.uncaught_rms_percent);
  json["caught_frames"] = row.caught_frames;
  json["caught_error_percent"] = or_null(row.caught_error_percent);
  json["god_object_rms_mm"] = or_null(a.god_object_rms_mm);
  json["excess_jumps"] = or_null(a.excess_jumps);
  json["missed_contact_frames"] = a.missed_contact_frames;
  json["false_contact_frames"] = a.false_contact_frames;
  json["longest_stick_frames"] = a.longest_stick_frames;
  json["pop_throughs"] = or_null(a.pop_throughs);
  json["energy_generated_percent"] = or_null(row.energy_percent);
  json["loops_generated_percent"] = or_null(row.loop_energy_percent);
  json["worst_loop_generated_percent"] = or_null(row.worst_loop_percent);
  json["free_force_n"] = row.free_force_n;
  json["free_frames_held_percent"] = row.held_share;
  json["contact_ns"] = row.contact_ns;
  json["all_ns"] = row.all_ns;
  json["p999_us"] = or_null(row.p999_us);
  json["prepare_ms"] = row.prepare_ms;
  json["bytes_per_point"] = row.bytes_per_point;
  json["bound_hits"] = row.bound_hits;
  json["summary"] = fmt::format("{} / {} / {} / {}", number(a.force_rms_percent), a.excess_jumps.value_or(0),
                                a.missed_contact_frames + a.false_contact_frames, number(row.energy_percent));
  json["times"] = fmt::format("{:.3g} / {:.3g} / {:.3g}", row.contact_ns, row.all_ns, row.prepare_ms);
  json["prepare_cpu_ms"] = row.prepare_cpu_ms;
  json["errors"] = fmt::format("{} / {} / {} / {}", number(a.force_rms_percent), a.missed_contact_frames,
                               a.false_contact_frames, a.excess_jumps.value_or(0));
  json["trace_hash"] = row.trace_hash;
  json["warnings"] = row.warnings;
  return json;
}

[[nodiscard]] Status write_json(const Arguments& arguments, const nlohmann::ordered_json& sets,
                                const std::vector<Row>& rows) {
  if (arguments.json.empty()) return Done{};
  nlohmann::ordered_json document = {{"schema", "palpate.felt-surface/1"},
                                     {"commit", arguments.commit},
                                     {"started_utc", arguments.started_utc},
                                     {"machine", {{"cpu", metrics::machine_info().cpu}}},
                                     {"quick", arguments.quick},
                                     {"seed", arguments.seed},
                                     {"stiffness_n_per_mm", kStiffness},
                                     {"closed_paths", arguments.trial.loops},
                                     {"sets", sets}};
  std::map<std::string, double> prepared;  // over all sets
  for (const Row& row : rows) {
    document["rows"].push_back(json_of(row));
    prepared[row.renderer] += row.prepare_cpu_ms;
  }
  for (const auto& [renderer, ms] : prepared)
    document["renderers"].push_back({{"label", renderer}, {"prepare_cpu_ms", ms}});
  return write_file(arguments.json, document.dump(1) + '\n');
}

[[nodiscard]] Status read(int argc, char** argv, Arguments& arguments) {
  std::string renderers;
  for (int i = 1; i < argc; ++i) {
    const std::string key = argv[i];
    if (key == "--quick") {
      arguments.quick = true;
      continue;
    }
    if (key == "--list") {
      arguments.list = true;
      continue;
    }
    if (i + 1 == argc)
      return Error{key + " needs a value, or is not known", "see the head of felt_surface.cpp"};
    const std::string value = argv[++i];
    const Result<double> count = read_number(value, {0.0, 1e9});
    if (key == "--sets") {
      arguments.sets = split_list(value);
    } else if (key == "--renderers") {
      renderers = value;
    } else if (key == "--json") {
      arguments.json = value;
    } else if (key == "--commit") {
      arguments.commit = value;
    } else if (key == "--slice") {
      arguments.slice = value;
    } else if (!count) {
      return Error{key + ": " + count.error().message()};
    } else if (key == "--frames") {
      arguments.frames = static_cast<std::size_t>(*count);
    } else if (key == "--closed-paths") {
      arguments.trial.loops = static_cast<std::size_t>(*count);
    } else if (key == "--seed") {
      arguments.seed = static_cast<std::uint64_t>(*count);
    } else if (key == "--where") {
      arguments.trial.mistakes = static_cast<std::size_t>(*count);
    } else if (key == "--threads") {
      arguments.trial.threads = static_cast<int>(*count);
    } else if (key == "--prepare-limit-s") {
      arguments.trial.prepare_limit_s = *count;
    } else {
      return Error{key + " is not known", "see the head of felt_surface.cpp"};
    }
  }
  if (renderers.empty()) renderers = "cloud,mesh-godobject:mesh=advancing-front,mls-proxy";
  PALPATE_ASSIGN(arguments.renderers, read_tried(renderers));
  if (arguments.frames == 0) arguments.frames = arguments.quick ? kQuickFrames : kFrames;
  if (!arguments.slice.empty()) return Done{};
  if (arguments.sets.empty())
    for (const DataSet& set : data_sets()) arguments.sets.push_back(set.name);
  for (const std::string& name : arguments.sets)
    if (const Result<DataSet> set = choose_set(name, arguments.seed); !set) return set.error();
  return Done{};
}

int report(const Error& error, int status) {
  fmt::print(stderr, "felt_surface: {}\n", error.message());
  return status;
}

int run(Arguments& arguments) {
  arguments.started_utc = metrics::utc_now();
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  if (!arguments.slice.empty()) {
    const std::string name = arguments.sets.empty() ? "edge" : arguments.sets.front();
    const Status drawn = draw_slice(name, arguments.renderers, registry, arguments.slice);
    return drawn.ok() ? 0 : report(drawn.error(), 1);
  }
  std::vector<Row> rows;
  nlohmann::ordered_json sets = nlohmann::ordered_json::array();
  print_head();
  for (const std::string& name : arguments.sets) {
    const DataSet set = choose_set(name, arguments.seed).value();
    const Result<Ground> ground = make_ground(set, arguments.quick, arguments.frames, no_progress());
    if (!ground) {
      fmt::print("{:8} {}: {}\n", name, ground.error().gave_up ? "skipped" : "failed",
                 ground.error().message());
      continue;
    }
    sets.push_back({{"label", name},
                    {"about", set.about},
                    {"model", arguments.quick ? set.quick : set.generate},
                    {"points", ground->points().size()},
                    {"frames", ground->path.size()},
                    {"truth", ground->reference.exactness}});
    const std::vector<trace::ProbePath> loops = closed_loops(*ground, arguments.trial.loops);
    for (const Tried& renderer : arguments.renderers) {
      rows.push_back(run_trial(set, *ground, renderer, loops, registry, arguments.trial));
      print_row(rows.back());
      print_mistakes(rows.back());
      std::fflush(stdout);
      if (const Status written = write_json(arguments, sets, rows); !written.ok())
        return report(written.error(), 1);
    }
  }
  return 0;
}

int main_of(int argc, char** argv) {
  Arguments arguments;
  if (const Status done = read(argc, argv, arguments); !done.ok()) {
    return report(done.error(), kBadArguments);
  }
  if (!arguments.list) return run(arguments);
  for (const DataSet& set : data_sets()) fmt::print("{:8} {:50} {}\n", set.name, set.about, set.generate);
  return 0;
}

}  // namespace
}  // namespace palpate::felt

int main(int argc, char** argv) {
  try {
    return palpate::felt::main_of(argc, argv);
  } catch (const std::exception& error) {
    std::fputs(error.what(), stderr);
    return 1;
  }
}
