#include "experiments/trade/measure.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include <palpate/result.h>
#include "experiments/run/work.h"
#include "toolkit/core/hash.h"
#include "toolkit/metrics/machine_info.h"

namespace palpate::experiments {
namespace {

// Slower preparations run once: three of a minute each would be a third of a sweep.
constexpr double kRepeatedBelowMs = 2000.0;
constexpr double kWorstShare = 0.05;  // share of frames beyond the 95th percentile
constexpr double kToPercentOfTruth = 100.0;

/// Rounds to steps of the model's largest extent over 2^bits, from its lowest corner.
struct Rounding {
  Vec3 from_mm;
  double step_mm;
  [[nodiscard]] Vec3 operator()(const Vec3& p) const {
    Vec3 rounded;
    for (int a = 0; a < 3; ++a) rounded[a] = from_mm[a] + std::round((p[a] - from_mm[a]) / step_mm) * step_mm;
    return rounded;
  }
};

void round_model(render::ModelInput& model, int bits) {
  const geometry::Aabb box = model.cloud->box_mm();
  const double extent = box.extent_mm().maxCoeff();
  if (!(extent > 0.0)) return;
  const Rounding rounding{box.low_mm, std::ldexp(extent, -bits)};
  cloud::Cloud rounded = *model.cloud;
  for (std::size_t i = 0; i < rounded.size(); ++i) {
    const Vec3 local = rounding(rounded.point_mm(i)) - rounded.origin_mm;
    rounded.x_mm[i] = static_cast<float>(local.x());
    rounded.y_mm[i] = static_cast<float>(local.y());
    rounded.z_mm[i] = static_cast<float>(local.z());
  }
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(rounded));
  if (model.original_mesh == nullptr) return;
  geometry::TriangleMesh mesh = *model.original_mesh;
  for (Vec3& vertex : mesh.vertices_mm) vertex = rounding(vertex);
  model.original_mesh = std::make_shared<const geometry::TriangleMesh>(std::move(mesh));
}

/// Always makes a mesh anew, since its preparation is measured.
RendererRequest measured_request(const Setting& setting, const render::Registry& registry) {
  RendererRequest request = setting.request;
  const render::RendererInfo& info = *registry.find(request.name);
  const bool caches = std::any_of(info.options.begin(), info.options.end(),
                                  [](const OptionSpec& spec) { return spec.key == "mesh_cache"; });
  if (!caches || request.options.has("mesh_cache")) return request;
  Options uncached = request.options;
  uncached.set("mesh_cache", "false");
  if (registry.make(request.name, uncached)) request.options = std::move(uncached);
  return request;
}

/// Repeats the preparation, each time in its own process.
std::vector<double> prepared_again(const Stage& stage, const RendererRequest& request, const Run& first,
                                   const render::Registry& registry, const RunOptions& options,
                                   Progress& progress) {
  std::vector<double> ms = {first.result.prepare->total_ms};
  if (first.result.prepare->total_ms > kRepeatedBelowMs) return ms;
  while (ms.size() < kPreparations) {
    Seat seat(stage, request, registry, options, true);
    const Result<std::string> prepared = seat.ask(Task::kPrepare, progress);
    const Result<Run> run = prepared ? run_of(*prepared) : Result<Run>(prepared.error());
    if (!run || !run->result.prepare) break;
    ms.push_back(run->result.prepare->total_ms);
  }
  return ms;
}

Measured with_extremes(std::vector<double> values) {
  std::sort(values.begin(), values.end());
  Measured measured{values[values.size() / 2]};
  if (values.size() > 1) measured.interval = Interval{values.front(), values.back()};
  return measured;
}

Measured scaled(const Measured& measured, double factor) {
  Measured all{measured.value * factor, measured.interval};
  if (all.interval) all.interval = Interval{all.interval->low * factor, all.interval->high * factor};
  return all;
}

/// The row's facts known before the run.
Row begin_row(const Experiment& experiment, const Setting& setting, const render::Registry& registry,
              const MeasureOptions& options) {
  Row row;
  row.setting = setting.text;
  row.experiment = experiment.hash;
  row.machine = this_machine();
  row.renderer = setting.request.name;
  row.works_on = render::name_of(registry.find(setting.request.name)->geometry);
  row.options.assign(setting.given.all().begin(), setting.given.all().end());
  row.axes = setting.axes;
  row.precision_bits = setting.precision_bits;
  row.rate_divisor = setting.rate_divisor;
  row.rate_hz = experiment.rate_hz / setting.rate_divisor;
  row.prepare_limit_s = options.prepare_limit_s;
  row.budget_s = options.budget_s;
  for (const render::ModelInput& model : experiment.stage->scene.input.models)
    row.scene_points += model.cloud->size();
  row.measured_utc = metrics::utc_now();
  return row;
}

void fill_frames(const Run& run, Row& row) {
  const trace::FrameStatistics& all = *run.result.frame_all;
  row.frame_mean_us = Measured{*all.mean_us, all.mean_interval_us};
  row.frame_p999_us = Measured{*all.p999_us, all.p999_interval_us};
  constexpr double kUsPerS = 1e6;
  row.load_percent = scaled(*row.frame_mean_us, kToPercentOfTruth * row.rate_hz / kUsPerS);
  row.passes = all.passes;
}

void fail_row(Row& row, metrics::RunStatus status, const std::string& reason) {
  row.status = status == metrics::RunStatus::kDidNotFinish ? "did-not-finish" : "failed";
  row.reason = reason;
}

/// Scores over the whole path at the truth's rate.
void fill_errors(const Experiment& experiment, const Setting& setting, Run& run, Row& row) {
  Run whole;
  whole.result = run.result;
  whole.trace = held(run.trace, experiment.stage->path, setting.rate_divisor);
  const Stage judged = stage_seen(*experiment.stage, 0, 1);
  if (setting.rate_divisor > 1) {
    if (const Status scored = score_run(judged, whole); !scored)
      return fail_row(row, metrics::RunStatus::kFailed, scored.error().message());
  } else {
    whole.per_frame = std::move(run.per_frame);
  }
  const metrics::Accuracy& accuracy = *whole.result.accuracy;
  row.error_p95_percent = error_p95(experiment, whole);
  row.error_rms_percent = accuracy.force_rms_percent;
  row.error_floor_percent = kToPercentOfTruth * accuracy.rounding_n / experiment.truth_rms_n;
  row.indistinguishable_percent = accuracy.indistinguishable_percent;
  if (!row.error_p95_percent)
    fail_row(row, metrics::RunStatus::kFailed, "neither it nor the truth is ever in contact");
}

}  // namespace

Result<Experiment> experiment_on(const Stage& stage, const std::string& program) {
  if (const std::optional<Error> none = why_no_truth(stage.scene.input)) return *none;
  if (!stage.reference)
    return Error{"there is no ground truth, so nothing can be said of accuracy",
                 "name a mesh of the same object with --reference"};
  if (!stage.forces_comparable)
    return Error{"the ground truth is of a rigid surface without friction or texture, and the scene has more",
                 "leave friction, deformation, texture and dents out of the scene"};
  Experiment experiment{&stage, {}, 0.0, 0.0, {}, 1};
  const auto& frames = stage.reference->frames;
  double squares = 0.0;
  std::size_t contact = 0, episode = 0;
  for (std::size_t i = 0; i < frames.size(); ++i) {
    const bool touches = frames[i].frame.force_n.squaredNorm() > 0.0;
    if (touches && contact > 0 && frames[i - 1].frame.force_n.squaredNorm() == 0.0) ++episode;
    if (touches) squares += frames[i].frame.force_n.squaredNorm(), ++contact;
    experiment.episode_of.push_back(static_cast<std::uint32_t>(episode));
  }
  if (contact == 0 || frames.size() < 2)
    return Error{"the path never touches the model", "give --path one that does"};
  experiment.episodes = episode + 1;
  experiment.truth_rms_n = std::sqrt(squares / static_cast<double>(contact));
  const std::vector<double>& t = stage.path.t_s;
  experiment.rate_hz = static_cast<double>(t.size() - 1) / (t.back() - t.front());
  Hash64 hash;
  const auto add = [&](const std::string& text) {
    hash.u64(text.size());
    hash.bytes(std::as_bytes(std::span(text)));
  };
  for (const scene::Provenance& from : stage.scene.provenance) add(from.content_hash);
  add(trace::path_hash(stage.path));
  add(trace::trace_hash(metrics::as_trace(*stage.reference)));
  hash.real(stage.scene.input.force_limit_n);
  hash.byte(stage.scene.control.any() ? 1 : 0);
  add(program);
  experiment.hash = hash.hex();
  return experiment;
}

Stage stage_seen(const Stage& stage, int precision_bits, int rate_divisor) {
  Stage seen;
  seen.scene_name = stage.scene_name;
  seen.scene = stage.scene;
  seen.starts_free = stage.starts_free;
  seen.forces_comparable = stage.forces_comparable;
  seen.spacing = stage.spacing;
  if (precision_bits > 0)
    for (render::ModelInput& model : seen.scene.input.models) round_model(model, precision_bits);
  seen.path.name = stage.path.name;
  const auto every = static_cast<std::size_t>(rate_divisor);
  if (stage.reference) {
    seen.reference.emplace();
    seen.reference->name = stage.reference->name;
    seen.reference->exactness = stage.reference->exactness;
  }
  for (std::size_t i = 0; i < stage.path.size(); i += every) {
    seen.path.t_s.push_back(stage.path.t_s[i]);
    seen.path.hip_mm.push_back(stage.path.hip_mm[i]);
    if (stage.reference) seen.reference->frames.push_back(stage.reference->frames[i]);
  }
  return seen;
}

trace::ForceTrace held(const trace::ForceTrace& trace, const trace::ProbePath& path, int rate_divisor) {
  if (rate_divisor == 1) return trace;
  trace::ForceTrace whole;
  whole.label = trace.label;
  for (std::size_t i = 0; i < path.size(); ++i) {
    render::Frame frame = trace.frames[i / static_cast<std::size_t>(rate_divisor)];
    if (frame.force_n.squaredNorm() == 0.0) {
      frame.contact = false;
      frame.model = -1;
      frame.god_object_mm = path.hip_mm[i];
    }
    whole.frames.push_back(frame);
  }
  return whole;
}

std::optional<Measured> error_p95(const Experiment& experiment, const Run& run) {
  // Sorted by size, largest first, so a resample's percentile is found by walking down.
  struct Sized {
    float error_n;
    std::uint32_t episode;
  };
  std::vector<Sized> errors;
  const std::vector<trace::TruthFrame>& truth = experiment.stage->reference->frames;
  for (std::size_t i = 0; i < truth.size(); ++i)
    if (truth[i].frame.force_n.squaredNorm() > 0.0 || run.trace.frames[i].force_n.squaredNorm() > 0.0)
      errors.push_back({run.per_frame.force_error_n[i], experiment.episode_of[i]});
  if (errors.empty()) return std::nullopt;
  std::sort(errors.begin(), errors.end(), [](const Sized& a, const Sized& b) {
    return a.error_n != b.error_n ? a.error_n > b.error_n : a.episode < b.episode;
  });
  std::vector<double> in_episode(experiment.episodes);
  for (const Sized& one : errors) ++in_episode[one.episode];
  const auto p95 = [&](std::span<const std::uint32_t> counts) -> std::optional<double> {
    double all = 0.0, beyond = 0.0;
    for (std::size_t e = 0; e < counts.size(); ++e) all += counts[e] * in_episode[e];
    if (!(all > 0.0)) return std::nullopt;
    for (const Sized& one : errors) {
      beyond += counts[one.episode];
      if (beyond > kWorstShare * all)
        return kToPercentOfTruth * static_cast<double>(one.error_n) / experiment.truth_rms_n;
    }
    return 0.0;
  };
  const std::vector<std::uint32_t> once(experiment.episodes, 1u);
  return Measured{*p95(once), bootstrap(experiment.episodes, [&](std::span<const std::uint32_t> counts,
                                                                 Random&) { return p95(counts); })};
}

Result<std::vector<Row>> measure(const Experiment& experiment, std::span<const Setting> settings,
                                 const Setting& anchor, const render::Registry& registry,
                                 const MeasureOptions& options, Progress& progress) {
  const Stage seen =
      stage_seen(*experiment.stage, settings.front().precision_bits, settings.front().rate_divisor);
  RunOptions run_options;
  run_options.threads = options.threads;
  run_options.passes = options.passes;
  run_options.budget_s = options.budget_s;
  run_options.prepare_limit_s = options.prepare_limit_s;
  std::vector<RendererRequest> requests;
  for (const Setting& setting : settings) requests.push_back(measured_request(setting, registry));
  std::size_t anchored = 0;
  while (anchored < settings.size() && settings[anchored].request.label != anchor.request.label) ++anchored;
  if (anchored == settings.size()) requests.push_back(measured_request(anchor, registry));
  metrics::MeasurementConditions conditions;
  PALPATE_ASSIGN(std::vector<Run> runs,
                 run_renderers(seen, requests, registry, run_options, progress, conditions, {}));
  std::vector<Row> rows;
  for (std::size_t i = 0; i < settings.size(); ++i) {
    Row row = begin_row(experiment, settings[i], registry, options);
    const metrics::RendererResult& result = runs[i].result;
    row.points = result.model ? result.model->points : 0;
    row.steal_percent = conditions.steal_percent.value_or(0.0);
    row.load_before = conditions.load_before;
    if (result.status != metrics::RunStatus::kOk) {
      fail_row(row, result.status, result.reason);
      rows.push_back(std::move(row));
      continue;
    }
    row.trace_hash = result.trace_hash;
    row.bytes = result.prepare->bytes;
    row.from_cache = result.prepare_clock && result.prepare_clock->from_cache;
    const std::vector<double> prepared =
        prepared_again(seen, requests[i], runs[i], registry, run_options, progress);
    row.prepare_ms = with_extremes(prepared);
    row.preparations = prepared.size();
    fill_frames(runs[i], row);
    // The anchor is comparable only at the path's own rate; other rates have longer steps.
    if (runs[anchored].result.frame_all && settings[i].rate_divisor == 1)
      row.anchor_us = runs[anchored].result.frame_all->mean_us;
    fill_errors(experiment, settings[i], runs[i], row);
    rows.push_back(std::move(row));
  }
  return rows;
}

}  // namespace palpate::experiments
