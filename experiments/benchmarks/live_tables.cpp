// Two tables on switching renderers during contact. Errors of a renderer just brought up, against the same
// one tracking throughout; and memory of two renderers on one model, against one. Counted, not timed: equal
// on every machine except for libraries' memory. See docs/results/hands-and-loops.md.
//
//   live_tables [KEY=VALUE ...]     scene=sinusoid:points=10201 switches=200 step_mm=0.5 renderers=A,B
//                                    json=FILE
#include <fmt/format.h>
#include <malloc.h>

#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include <palpate/baselines.h>
#include <palpate/device/contact_catch_up.h>
#include <palpate/model_store.h>
#include <palpate/options.h>
#include <palpate/registry.h>
#include <palpate/result.h>
#include "experiments/benchmarks/weave_scene.h"
#include "toolkit/core/files.h"
#include "toolkit/core/messages.h"

namespace {

using namespace palpate;

constexpr long long kTableFrames = 20'000;
using Json = nlohmann::ordered_json;

// The mixer's bring-up steps per tick of a standby.
constexpr int kStepsATick = 4;
// Frames after readiness: at once, and at 4 and 75 % of a 150 ms fade.
constexpr std::size_t kLater[] = {0, 10, 100};
constexpr std::size_t kMostFrames = 400;  // for one bring-up, far more than needed

struct TableArguments {
  std::string scene = "sinusoid:points=10201", json;
  std::vector<std::string> renderers;
  int switches = 200;
  double step_mm = render::ContactCatchUpOptions{}.step_mm;
};

/// One renderer's row of both tables.
struct TableRow {
  std::string name, not_run;
  int switches = 0, contact_differs = 0, ready_frames_max = 0;
  double p50_n[std::size(kLater)]{}, max_n[std::size(kLater)]{};
  double own_step_p99_n = 0.0, force_p50_n = 0.0;
  double one_bytes = 0.0, two_apart_bytes = 0.0, two_shared_bytes = 0.0, said_shared_bytes = 0.0;
};

double rank(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto at = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1) + 0.5);
  std::nth_element(values.begin(), values.begin() + at, values.end());
  return values[static_cast<std::size_t>(at)];
}

/// Bytes allocated by the process and not freed.
double allocated_bytes() {
  malloc_trim(0);
  const struct mallinfo2 info = mallinfo2();
  return static_cast<double>(info.uordblks + info.hblkhd);
}

Result<TableArguments> read_arguments(int argc, char** argv) {
  TableArguments a;
  for (int i = 1; i < argc; ++i) {
    const std::string word = argv[i], key = word.substr(0, word.find('='));
    const std::string value = word.size() > key.size() ? word.substr(key.size() + 1) : "";
    if (key == "scene") {
      a.scene = value;
    } else if (key == "renderers") {
      a.renderers = split_list(value);
    } else if (key == "json") {
      a.json = value;
    } else if (key == "step_mm") {
      PALPATE_ASSIGN(a.step_mm, read_number(value, {1e-3, 1e3}));
    } else if (key == "switches") {
      PALPATE_ASSIGN(const long long switches, read_integer(value, {1, 100'000}));
      a.switches = static_cast<int>(switches);
    } else {
      return Error{"unknown key " + key, "give scene, switches, step_mm, renderers or json"};
    }
  }
  return a;
}

using Renderer = std::unique_ptr<render::HapticRenderer>;
Result<Renderer> prepared(const render::Registry& registry, const NamedOptions& named,
                          const render::SceneInput& scene, render::ModelStore* store, double* shared) {
  PALPATE_ASSIGN(Renderer made, registry.make(named.name, named.options));
  render::PrepareContext context;
  context.store = store;
  PALPATE_ASSIGN(const render::PrepareReport report, made->prepare(scene, context));
  if (shared != nullptr) *shared = static_cast<double>(report.shared_bytes);
  return made;
}

/// Every frame of the tracking renderer, and its last free position before each.
struct Tracked {
  std::vector<render::Frame> frames;
  std::vector<Vec3> last_free_mm;
  std::vector<std::size_t> contact;
};
Tracked track(render::HapticRenderer& renderer, const trace::ProbePath& path, TableRow& row) {
  Tracked all;
  Vec3 free_mm = path.hip_mm.front();
  renderer.restart(free_mm, path.t_s.front());
  std::vector<double> steps_n, forces_n;
  for (std::size_t i = 0; i < path.size(); ++i) {
    all.last_free_mm.push_back(free_mm);
    all.frames.push_back(renderer.step(path.hip_mm[i], path.t_s[i]));
    const render::Frame& now = all.frames.back();
    if (!now.contact) {
      free_mm = path.hip_mm[i];
      continue;
    }
    if (i + kMostFrames + kLater[2] < path.size()) all.contact.push_back(i);
    forces_n.push_back(now.force_n.norm());
    if (i > 0 && all.frames[i - 1].contact)
      steps_n.push_back((now.force_n - all.frames[i - 1].force_n).norm());
  }
  row.own_step_p99_n = rank(steps_n, 0.99);
  row.force_p50_n = rank(forces_n, 0.5);
  return all;
}

void bring_up_errors(render::HapticRenderer& late, const Tracked& tracked, const trace::ProbePath& path,
                     const TableArguments& a, TableRow& row) {
  std::vector<double> errors_n[std::size(kLater)];
  late.restart(path.hip_mm.front(), path.t_s.front());
  const std::size_t wanted =
      std::min<std::size_t>(static_cast<std::size_t>(a.switches), tracked.contact.size());
  for (std::size_t s = 0; s < wanted; ++s) {
    const std::size_t begin = tracked.contact[s * tracked.contact.size() / wanted];
    render::ContactCatchUp catch_up({a.step_mm, kStepsATick});
    catch_up.begin(late, tracked.last_free_mm[begin], begin > 0 ? path.t_s[begin - 1] : path.t_s[begin]);
    std::size_t ready = 0;  // frames until ready
    for (std::size_t i = begin; i < begin + kMostFrames; ++i) {
      const render::Frame frame = catch_up.pending() ? catch_up.advance(late, path.hip_mm[i], path.t_s[i])
                                                     : late.step(path.hip_mm[i], path.t_s[i]);
      if (catch_up.pending()) continue;
      if (ready == 0) ready = i - begin + 1;
      const std::size_t since = i - begin + 1 - ready;
      if (since == 0 && frame.contact != tracked.frames[i].contact) ++row.contact_differs;
      for (std::size_t k = 0; k < std::size(kLater); ++k)
        if (since == kLater[k]) errors_n[k].push_back((frame.force_n - tracked.frames[i].force_n).norm());
      if (since == kLater[2]) break;
    }
    row.ready_frames_max = std::max(row.ready_frames_max, static_cast<int>(ready));
    ++row.switches;
  }
  for (std::size_t k = 0; k < std::size(kLater); ++k) {
    row.p50_n[k] = rank(errors_n[k], 0.5);
    row.max_n[k] = rank(errors_n[k], 1.0);
  }
}

/// Measures one renderer, two with own stores, and two on one store. The first run warms up permanent
/// allocations of libraries.
Status weigh(const render::Registry& registry, const NamedOptions& named, const render::SceneInput& scene,
             TableRow& row) {
  PALPATE_TRY(prepared(registry, named, scene, nullptr, nullptr));
  const auto growth = [&](int count, render::ModelStore* store, double& bytes) -> Status {
    const double before = allocated_bytes();
    std::vector<Renderer> held;
    for (int i = 0; i < count; ++i) {
      PALPATE_ASSIGN(Renderer one, prepared(registry, named, scene, store, &row.said_shared_bytes));
      held.push_back(std::move(one));
    }
    bytes = allocated_bytes() - before;
    return Done{};
  };
  PALPATE_TRY(growth(1, nullptr, row.one_bytes));
  PALPATE_TRY(growth(2, nullptr, row.two_apart_bytes));
  render::ModelStore store;
  return growth(2, &store, row.two_shared_bytes);
}

Result<TableRow> row_of(const render::Registry& registry, const std::string& text,
                        const experiments::WeaveScene& scene, const TableArguments& a) {
  TableRow row;
  row.name = text;
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(text));
  const render::RendererInfo* info = registry.find(named.name);
  if (info == nullptr)
    return Error{"there is no renderer " + shown(named.name), "see palpate list renderers"};
  if (const Status able = registry.check_supports(*info, scene.input); !able) {
    row.not_run = able.error().what;
    return row;
  }
  const Status weighed = weigh(registry, named, scene.input, row);
  if (!weighed) {
    row.not_run = weighed.error().what;
    return row;
  }
  PALPATE_ASSIGN(const Renderer there, prepared(registry, named, scene.input, nullptr, nullptr));
  PALPATE_ASSIGN(const Renderer late, prepared(registry, named, scene.input, nullptr, nullptr));
  bring_up_errors(*late, track(*there, scene.path, row), scene.path, a, row);
  return row;
}

Json json_of(const TableRow& row) {
  if (!row.not_run.empty()) return {{"renderer", row.name}, {"not_run", row.not_run}};
  Json errors = Json::array();
  for (std::size_t k = 0; k < std::size(kLater); ++k)
    errors.push_back({{"after_ms", kLater[k]}, {"p50_n", row.p50_n[k]}, {"max_n", row.max_n[k]}});
  return {{"renderer", row.name},
          {"switches", row.switches},
          {"contact_differs", row.contact_differs},
          {"ready_frames_max", row.ready_frames_max},
          {"errors", std::move(errors)},
          {"force_p50_n", row.force_p50_n},
          {"own_step_p99_n", row.own_step_p99_n},
          {"bytes",
           {{"one", row.one_bytes},
            {"two_apart", row.two_apart_bytes},
            {"two_shared", row.two_shared_bytes},
            {"said_shared", row.said_shared_bytes}}}};
}

void print_row(const TableRow& row) {
  if (!row.not_run.empty()) {
    fmt::print("| `{}` | not run: {} | | | | | | | | |\n", row.name, row.not_run);
    return;
  }
  fmt::print(
      "| `{}` | {} | {} | {:.2g} / {:.2g} | {:.2g} / {:.2g} | {:.2g} / {:.2g} | {:.2g} | {} | {} | {} |\n",
      row.name, row.ready_frames_max, row.contact_differs, row.p50_n[0], row.max_n[0], row.p50_n[1],
      row.max_n[1], row.p50_n[2], row.max_n[2], row.own_step_p99_n, format_bytes(row.one_bytes),
      format_bytes(row.two_apart_bytes), format_bytes(row.two_shared_bytes));
  std::fflush(stdout);
}

Status run(const TableArguments& a) {
  PALPATE_ASSIGN(const experiments::WeaveScene scene, experiments::weave_scene(a.scene, kTableFrames));
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  std::vector<std::string> names = a.renderers;
  if (names.empty()) names = names_of(registry.all());
  fmt::print(
      "| renderer | ready after, frames | contact differs | at once: p50 / max, N | 10 ms | 100 ms | its own "
      "steps, p99, N | one | two apart | two on one store |\n");
  fmt::print("| --- | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: | ---: |\n");
  Json rows = Json::array();
  for (const std::string& name : names) {
    PALPATE_ASSIGN(const TableRow row, row_of(registry, name, scene, a));
    print_row(row);
    rows.push_back(json_of(row));
  }
  if (a.json.empty()) return Done{};
  const Json document = {{"schema", "palpate-live-tables/1"},
                         {"scene", a.scene},
                         {"points", scene.input.models.front().cloud->size()},
                         {"path", scene.path.name},
                         {"step_mm", a.step_mm},
                         {"rows", std::move(rows)}};
  return write_file(a.json, document.dump(1) + "\n");
}

}  // namespace

int main(int argc, char** argv) {
  const Result<TableArguments> arguments = read_arguments(argc, argv);
  const Status ran = arguments ? run(*arguments) : Status(arguments.error());
  if (ran) return 0;
  fmt::print(stderr, "live_tables: {}\n", ran.error().message());
  return arguments ? 1 : 2;
}
