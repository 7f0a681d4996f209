#include "experiments/stress/stress.h"

#include <fmt/format.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <ctime>
#include <exception>
#include <optional>

#include <palpate/clock.h>
#include <palpate/result.h>
#include "experiments/driver/json_document.h"
#include "experiments/driver/suite.h"
#include "experiments/run/work.h"
#include "experiments/stress/cell.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/wrapped_renderer.h"

namespace palpate::experiments {
namespace {

constexpr const char* kShownInBothFrames = "mesh-godobject";

bool names_it(const StressCase& one, const std::string& word) {
  return one.name == word || one.group == word;
}

Result<std::vector<StressCase>> chosen_cases(const StressArguments& arguments) {
  std::vector<StressCase> all = stress_cases();
  const std::vector<std::string> words =
      arguments.cases.empty() ? std::vector<std::string>() : split_list(arguments.cases);
  for (const std::string& word : words)
    if (std::none_of(all.begin(), all.end(), [&](const StressCase& one) { return names_it(one, word); })) {
      std::string known, group;
      for (const StressCase& one : all) {
        if (one.group != group) {
          known += (group.empty() ? "" : ", ") + one.group + " (";
          group = one.group;
        }
        known += one.name + (&one == &all.back() || (&one + 1)->group != group ? ")" : " ");
      }
      return Error{fmt::format("there is no case '{}'", word), "choose cases or whole groups from " + known};
    }
  std::erase_if(all, [&](const StressCase& one) {
    const bool named =
        std::any_of(words.begin(), words.end(), [&](const std::string& w) { return names_it(one, w); });
    return (!words.empty() && !named) || (arguments.quick && !one.quick);
  });
  if (all.empty())
    return Error{"none of these cases is of the short set", "leave out --quick, or name others"};
  return all;
}

Result<std::vector<RendererRequest>> chosen_renderers(const std::string& text,
                                                      const render::Registry& registry) {
  if (!text.empty()) return parse_renderers(text, registry);
  std::vector<RendererRequest> requests;
  for (const render::RendererInfo& info : registry.all()) {
    if (info.geometry == render::Geometry::kImages) continue;  // no case has a camera
    requests.push_back({info.name, info.name, {}, {}});
    // Adds the world frame, where single precision holds the file's coordinates.
    if (info.name != kShownInBothFrames) continue;
    Options world;
    world.set("frame", "world");
    requests.push_back({std::string(kShownInBothFrames) + "-world", info.name, std::move(world), {}});
  }
  return requests;
}

/// Runs the rows and keeps complete ones.
class StressRun {
 public:
  StressRun(const StressArguments& arguments, const render::Registry& registry, const Suite& suite,
            StressMatrix& matrix)
      : arguments_(arguments), registry_(registry), suite_(suite), matrix_(matrix) {
    limits_.seconds = arguments.cell_s;
    for (const StressCase& one : matrix.cases)
      if (!one.full || arguments.full) run_.push_back(one);
  }

  Status all() {
    for (std::size_t r = 0; r < matrix_.renderers.size(); ++r) {
      const RendererRequest& request = matrix_.renderers[r];
      suite_.progress().set_prefix(fmt::format("[{}/{}] ", r + 1, matrix_.renderers.size()));
      std::vector<StressCell> row;
      if (!suite_.take(request.label, key_of(request), row) && !spent() &&
          suite_.measures(untimed(request))) {
        run_row(request, r, row);
        if (row.size() == run_.size()) PALPATE_TRY(suite_.keep(request.label, key_of(request), row));
      }
      matrix_.cells.push_back(spread(request, row));
    }
    suite_.progress().set_prefix("");
    return Done{};
  }

 private:
  [[nodiscard]] bool spent() const {
    return arguments_.budget_s > 0.0 && !suite_.partial() && watch_.ms() > 1e3 * arguments_.budget_s;
  }

  void run_row(const RendererRequest& request, std::size_t r, std::vector<StressCell>& row) {
    const auto say = [&] {
      if (row.size() == run_.size()) return;
      const double done =
          static_cast<double>(r) + static_cast<double>(row.size()) / static_cast<double>(run_.size());
      suite_.progress().report(fmt::format("{} at the extremes", request.label),
                               done / static_cast<double>(matrix_.renderers.size()));
    };
    say();
    run_row_apart(run_, request, registry_, limits_, [&](StressCell&& cell) {
      row.push_back(std::move(cell));
      say();
      return !spent();
    });
  }

  /// Expands a row by the cells not run.
  std::vector<StressCell> spread(const RendererRequest& request, const std::vector<StressCell>& row) const {
    std::vector<StressCell> cells;
    for (const StressCase& one : matrix_.cases) {
      const auto at =
          std::find_if(row.begin(), row.end(), [&](const StressCell& c) { return c.name == one.name; });
      StressCell skipped;
      skipped.renderer = request.label;
      skipped.name = one.name;
      skipped.cause = one.full && !arguments_.full ? "only with --full" : "the budget was spent";
      cells.push_back(at != row.end() ? *at : skipped);
    }
    return cells;
  }

  const StressArguments& arguments_;
  const render::Registry& registry_;
  const Suite& suite_;
  StressMatrix& matrix_;
  CellLimits limits_;
  std::vector<StressCase> run_;  ///< the cases run
  Stopwatch watch_;
};

}  // namespace

Result<int> run_stress(const StressArguments& arguments, Context& context) {
  Suite suite(context);
  const render::Registry registry = all_renderers();
  StressMatrix matrix;
  PALPATE_ASSIGN(matrix.renderers, chosen_renderers(arguments.renderers, registry));
  for (const RendererRequest& request : matrix.renderers)
    matrix.roles.push_back(registry.find(request.name)->role);
  PALPATE_ASSIGN(matrix.cases, chosen_cases(arguments));
  matrix.head = new_head(context.command_line);
  std::optional<OtherHashes> other;
  if (!arguments.against.empty()) {
    PALPATE_ASSIGN(other, read_hashes(arguments.against));
  }
  PALPATE_TRY(suite.open(arguments.out));
  RunKey key;
  key.add(arguments.cases).add(arguments.cell_s);
  key.add(static_cast<std::uint64_t>(arguments.full)).add(static_cast<std::uint64_t>(arguments.quick));
  PALPATE_TRY(suite.begin(key));
  PALPATE_TRY(StressRun(arguments, registry, suite, matrix).all());
  if (suite.partial()) return suite.leave();
  SuiteResults results{kStressFile, stress_json(matrix), {stress_table(matrix), stress_summary(matrix)}};
  Page page = stress_page(matrix);
  bool short_of = failures(matrix, render::Role::kOurs) > 0;
  if (other) {
    const std::vector<HashRow> rows = compare_hashes(matrix, *other);
    results.json = with_hashes(results.json, rows, *other);
    results.tables.push_back(hash_table(rows, *other));
    page.sections.front().tables.push_back(results.tables.back());
    short_of = short_of || std::any_of(rows.begin(), rows.end(), [](const HashRow& row) {
                 return row.role == render::Role::kOurs && !row.different.empty();
               });
  }
  PALPATE_TRY(suite.folder().write("stress.svg", stress_picture(matrix)));
  PALPATE_TRY(suite.publish(results, page, arguments.json));
  return short_of ? kExitFellShort : kExitOk;
}

namespace {

using render::Frame;

// Share of due frames that may lack a force, at the ends of a contact.
constexpr double kMissedShare = 0.01;
// Passes for a frame's shortest time: an interrupt hits one, rarely three.
constexpr int kTimedPasses = 3;
// Rounding operations of limiting a force: a square root, a division, three products, and the norm taken
// here.
constexpr int kLimitOperations = 12;

double thread_seconds() noexcept {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

struct Pass {
  trace::ForceTrace trace;
  std::vector<double> frame_s;
};
Pass pass_of(render::HapticRenderer& renderer, const trace::ProbePath& path) {
  Pass pass;
  pass.trace.frames.resize(path.size());
  pass.frame_s.resize(path.size());
  const double first_s = path.size() > 1 ? path.t_s[1] - path.t_s[0] : 1e-3;
  renderer.restart(path.hip_mm.front(), path.t_s.front() - first_s);
  for (std::size_t i = 0; i < path.size(); ++i) {
    const double begun = thread_seconds();
    pass.trace.frames[i] = renderer.step(path.hip_mm[i], path.t_s[i]);
    pass.frame_s[i] = thread_seconds() - begun;
  }
  return pass;
}

struct Prepared {
  std::unique_ptr<render::HapticRenderer> renderer;
  std::string refused;  ///< reason; empty: not refused
  std::vector<std::string> warnings;
  double read_rounding_mm = 0.0;
};
Prepared prepare(const StressSetup& setup, const RendererRequest& request, const render::Registry& registry) {
  Prepared prepared;
  const render::RendererInfo& info = *registry.find(request.name);
  if (const Status able = registry.check_supports(info, setup.scene); !able) {
    prepared.refused = able.error().message();
    return prepared;
  }
  Options options = request.options;
  for (const auto& [key, value] : setup.options.all()) options.set(key, value);
  auto made = registry.make(request.name, options);
  if (!made) {
    prepared.refused = made.error().message();
    return prepared;
  }
  const auto ready = (*made)->prepare(setup.scene, {setup.threads, nullptr, nullptr});
  if (!ready) {
    prepared.refused = ready.error().message();
    return prepared;
  }
  prepared.warnings = ready->warnings;
  prepared.read_rounding_mm = ready->read_rounding_mm;
  prepared.renderer = *std::move(made);
  return prepared;
}

/// True if the renderer has options of all these names.
bool has_options(const render::RendererInfo& info, const Options& options) {
  return std::all_of(options.all().begin(), options.all().end(), [&](const auto& one) {
    return std::any_of(info.options.begin(), info.options.end(),
                       [&](const OptionSpec& spec) { return spec.key == one.first; });
  });
}

std::string place_text(const trace::ProbePath& path, std::size_t i) {
  const Vec3& h = path.hip_mm[i];
  return fmt::format("frame {}, HIP ({:g}, {:g}, {:g}) mm", i, h.x(), h.y(), h.z());
}

/// Counts the frames that break a rule and describes the first.
class Breaches {
 public:
  Breaches(const StressSetup& setup, StressCell& cell) : setup_(setup), cell_(cell) {}
  template <class Broken>
  void look(const char* check, const char* what, double allowed, const Broken& broken) {
    if (cell_.status == CellStatus::kFailed) return;
    std::size_t count = 0, first = 0;
    for (std::size_t i = 0; i < setup_.path.size(); ++i)
      if (broken(i) && count++ == 0) first = i;
    if (static_cast<double>(count) <= allowed) return;
    cell_.status = CellStatus::kFailed;
    cell_.check = check;
    cell_.cause = fmt::format("{} in {} of {} frames, first {}", what, count, setup_.path.size(),
                              place_text(setup_.path, first));
  }

 private:
  const StressSetup& setup_;
  StressCell& cell_;
};

void judge_frames(const StressSetup& setup, const std::vector<Frame>& frames, StressCell& cell) {
  Breaches breaches(setup, cell);
  const std::vector<Vec3>& hips = setup.path.hip_mm;
  breaches.look("finite", "a force or god object that is not finite", 0, [&](std::size_t i) {
    return !is_finite(frames[i].force_n) || (is_finite(hips[i]) && !is_finite(frames[i].god_object_mm));
  });
  breaches.look("finite", "a HIP that is no place is answered with a force, or without saying so", 0,
                [&](std::size_t i) {
                  return !is_finite(hips[i]) && (frames[i].status != render::FrameStatus::kNonFinite ||
                                                 frames[i].force_n != Vec3::Zero() || frames[i].contact);
                });
  const double limit = setup.scene.force_limit_n * (1.0 + gamma(kLimitOperations));
  breaches.look("limit", "a force above the limit", 0,
                [&](std::size_t i) { return frames[i].force_n.stableNorm() > limit; });
  breaches.look("free", "contact or force while the HIP is free", 0, [&](std::size_t i) {
    return setup.due[i] == Due::kFree && (frames[i].contact || frames[i].force_n != Vec3::Zero());
  });
  const auto inside = std::count(setup.due.begin(), setup.due.end(), Due::kInside);
  breaches.look(
      "felt", "no force where there must be one", kMissedShare * static_cast<double>(inside),
      [&](std::size_t i) { return setup.due[i] == Due::kInside && frames[i].force_n == Vec3::Zero(); });
  for (const Frame& frame : frames) {
    cell.contact_frames += frame.contact;
    cell.bound_hits += frame.status == render::FrameStatus::kBoundHit;
    cell.largest_force_n = std::max(cell.largest_force_n, frame.force_n.stableNorm());
  }
}

/// A warning about the input downgrades a wrong surface to a limit, as stated beforehand. It excuses no
/// crash, no force beyond the limit and no different replay.
void judge_warned(StressCell& cell) {
  if (cell.status != CellStatus::kFailed || cell.warnings.empty()) return;
  if (cell.check != "free" && cell.check != "felt") return;
  cell.status = CellStatus::kLimit;
  cell.cause = fmt::format("it warned: \"{}\"; then {}", fmt::join(cell.warnings, "\", \""), cell.cause);
}

/// A replay must be identical; a frame must end within the tick.
void judge_passes(const StressSetup& setup, render::HapticRenderer& renderer, Pass& first, StressCell& cell) {
  std::vector<double> least = first.frame_s;
  for (int pass = 1; pass < kTimedPasses; ++pass) {
    if (pass > 1 && *std::max_element(least.begin(), least.end()) <= setup.tick_s) break;
    const Pass next = pass_of(renderer, setup.path);
    if (trace_hash(next.trace) != cell.trace_hash && cell.status != CellStatus::kFailed) {
      cell.status = CellStatus::kFailed;
      cell.check = "replay";
      cell.cause = "a second replay of the same path gives other forces";
    }
    for (std::size_t i = 0; i < least.size(); ++i) least[i] = std::min(least[i], next.frame_s[i]);
  }
  const auto worst = std::max_element(least.begin(), least.end());
  if (*worst <= setup.tick_s || cell.status == CellStatus::kFailed) return;
  const std::string bound = renderer.describe().work_bound;
  const bool stated = render::may_miss_a_tick(bound);
  cell.status = stated ? CellStatus::kLimit : CellStatus::kFailed;
  cell.check = "bounded";
  cell.cause =
      fmt::format("a frame of {} of processor time, {}; its bound says: {}", format_duration(1e3 * *worst),
                  place_text(setup.path, static_cast<std::size_t>(worst - least.begin())), bound);
}

void judge_twin(const StressSetup& setup, const RendererRequest& request, const render::Registry& registry,
                const std::vector<Frame>& frames, StressCell& cell) {
  const Prepared twin = prepare(*setup.twin, request, registry);
  if (!twin.renderer) return;  // refused at unit scale: no comparison
  const Pass unit = pass_of(*twin.renderer, setup.twin->path);
  cell.twin_bound_n = setup.twin_bound_n + 2.0 * setup.twin_n_per_mm * twin.read_rounding_mm;
  std::size_t beyond = 0, first = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const double difference = (frames[i].force_n - unit.trace.frames[i].force_n).norm();
    cell.twin_difference_n = std::max(cell.twin_difference_n, difference);
    if (!(difference <= cell.twin_bound_n) && beyond++ == 0) first = i;
  }
  if (beyond == 0 || cell.status == CellStatus::kFailed) return;
  cell.status = CellStatus::kFailed;
  cell.check = "twin";
  cell.cause = fmt::format(
      "{} of {} forces differ from the twin's by more than rounding allows ({} N), by up to {} N, first {}",
      beyond, frames.size(), format_number(cell.twin_bound_n), format_number(cell.twin_difference_n),
      place_text(setup.path, first));
}

void fill_cell(const StressCase& one, const RendererRequest& request, const render::Registry& registry,
               StressCell& cell) {
  const Result<StressSetup> setup = one.make();
  if (!setup) {
    cell.status = CellStatus::kLimit;
    cell.cause = "no model is made: " + setup.error().message();
    return;
  }
  if (!has_options(*registry.find(request.name), setup->options)) {
    cell.cause = "it has no such option";
    return;
  }
  const Prepared prepared = prepare(*setup, request, registry);
  if (!prepared.renderer) {
    cell.status = CellStatus::kLimit;
    cell.cause = prepared.refused;
    return;
  }
  cell.status = CellStatus::kOk;
  Pass first = pass_of(*prepared.renderer, setup->path);
  cell.frames = first.trace.frames.size();
  cell.trace_hash = trace_hash(first.trace);
  cell.warnings = prepared.warnings;
  judge_frames(*setup, first.trace.frames, cell);
  judge_warned(cell);
  judge_passes(*setup, *prepared.renderer, first, cell);
  if (setup->twin) judge_twin(*setup, request, registry, first.trace.frames, cell);
}

}  // namespace

const char* name_of(CellStatus status) noexcept {
  constexpr const char* kNames[] = {"ok", "limit", "failed", "skipped"};
  return kNames[static_cast<std::size_t>(status)];
}

StressCell run_cell(const StressCase& one, const RendererRequest& request, const render::Registry& registry) {
  StressCell cell;
  cell.renderer = request.label;
  cell.name = one.name;
  try {
    fill_cell(one, request, registry, cell);
  } catch (const std::exception& error) {
    cell.status = CellStatus::kFailed;
    cell.check = "crash";
    cell.cause = fmt::format("an exception left it: {}", error.what());
  }
  return cell;
}

void run_row_apart(const std::vector<StressCase>& cases, const RendererRequest& request,
                   const render::Registry& registry, const CellLimits& limits,
                   const std::function<bool(StressCell&&)>& ready) {
  const auto work = [&](std::uint64_t task, Progress&) -> Result<std::string> {
    return to_line(run_cell(cases[task], request, registry));
  };
  for (std::size_t next = 0; next < cases.size();) {
    Child child(work, true, {limits.seconds, limits.bytes});
    for (; child.alive() && next < cases.size(); ++next) {
      const Result<std::string> line = child.ask(next, no_progress());
      StressCell cell;
      if (!line || !from_line(*line, cell)) {
        cell = {};
        cell.renderer = request.label;
        cell.name = cases[next].name;
        cell.status = CellStatus::kFailed;
        cell.check = "crash";
        cell.cause = line ? "its answer is no cell" : line.error().what;
      }
      if (!ready(std::move(cell))) return;
    }
  }
}

}  // namespace palpate::experiments
