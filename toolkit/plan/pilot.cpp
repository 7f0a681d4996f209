#include "toolkit/plan/pilot.h"

#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include "toolkit/core/numbers.h"
#include "toolkit/core/try.h"
#include "toolkit/trace/passes.h"
#include "toolkit/trace/paths.h"
#include "toolkit/trace/replay.h"

namespace palpate::plan {
namespace {

/// Timed passes along a cut-out; the fastest counts, what else ran on the machine is no renderer's.
constexpr int kPilotPasses = 5;
constexpr double kWarmUpS = 0.005;
/// Reads that wait, one after the other, for each point that the god object comes to: the point, what is
/// stored with it, and the way down to it where it is looked for. Measured: plan_check.
constexpr double kReadsPerPlace = 1.5;
constexpr double kNsPerUs = 1e3;

/// The points nearest to one of them in the largest of the three distances: of a raster a whole rectangle.
std::vector<std::uint32_t> around(const cloud::Cloud& cloud, std::size_t middle) {
  std::vector<std::uint32_t> all(cloud.size());
  std::iota(all.begin(), all.end(), 0u);
  if (all.size() <= kWholePilotPoints) return all;
  const Vec3 at = cloud.local_mm(middle);
  std::vector<double> far(cloud.size());
  for (std::size_t i = 0; i < far.size(); ++i) far[i] = (cloud.local_mm(i) - at).cwiseAbs().maxCoeff();
  std::vector<double> sorted = far;
  const auto nth = sorted.begin() + static_cast<std::ptrdiff_t>(kPilotPoints);
  std::nth_element(sorted.begin(), nth, sorted.end());
  std::erase_if(all, [&](std::uint32_t i) { return !(far[i] <= *nth); });
  return all;
}

std::vector<float> cut(const std::vector<float>& values, const std::vector<std::uint32_t>& of) {
  std::vector<float> out;
  if (values.empty()) return out;
  out.reserve(of.size());
  for (const std::uint32_t i : of) out.push_back(values[i]);
  return out;
}

/// A part of a model, alone and at rest, with the model's surface.
render::SceneInput cut_out(const render::SceneInput& scene, const render::ModelInput& whole,
                           const std::vector<std::uint32_t>& of) {
  auto part = std::make_shared<cloud::Cloud>();
  const cloud::Cloud& all = *whole.cloud;
  part->origin_mm = all.origin_mm;
  part->x_mm = cut(all.x_mm, of);
  part->y_mm = cut(all.y_mm, of);
  part->z_mm = cut(all.z_mm, of);
  if (of.size() == all.size()) part->raster = all.raster;
  render::ModelInput model;
  model.name = whole.name;
  model.surface = whole.surface;
  if (const surface::PointProperties* p = whole.surface.per_point.get()) {
    auto cut_properties = std::make_shared<surface::PointProperties>();
    cut_properties->stiffness_n_per_mm = cut(p->stiffness_n_per_mm, of);
    cut_properties->static_friction = cut(p->static_friction, of);
    cut_properties->dynamic_friction = cut(p->dynamic_friction, of);
    cut_properties->deformation = cut(p->deformation, of);
    model.surface.per_point = cut_properties;
  }
  model.cloud = part;
  render::SceneInput out;
  out.force_limit_n = scene.force_limit_n;
  out.models.push_back(std::move(model));
  return out;
}

/// Boxes and cells go by the resolution of the whole cloud.
Options options_for(const NamedOptions& renderer, const render::ModelDecisions& decided,
                    const render::Registry& registry) {
  Options options = renderer.options;
  const bool boxed = std::any_of(decided.decisions.begin(), decided.decisions.end(),
                                 [](const render::Decision& d) { return d.about == "boxes"; });
  if (!boxed || options.has("resolution_mm") || !decided.spacing_mm || !(*decided.spacing_mm > 0.0))
    return options;
  options.set("resolution_mm", fmt::format("{}", *decided.spacing_mm));
  // On stars an option of the vertices would choose them: there it is refused, or the boxes are not there.
  return registry.make(renderer.name, options).ok() ? options : renderer.options;
}

/// The mean of a model's cut-outs.
Result<FrameCost> model_cost(const render::SceneInput& scene, std::size_t index, const NamedOptions& renderer,
                             const render::Decisions& decided, double spacing_mm,
                             const render::Registry& registry, const std::string& path,
                             const Machine& machine) {
  const render::ModelInput& model = scene.models[index];
  const render::ModelDecisions& said = decided.models[index];
  const std::size_t n = model.cloud->size(), wanted = n <= kWholePilotPoints ? 1 : kPilots;
  const NamedOptions on_part{renderer.name, options_for(renderer, said, registry)};
  FrameCost cost;
  Flight mean;
  Error last{"no cut-out", {}, {}, 0};
  for (std::size_t k = 0; k < wanted; ++k) {
    const std::size_t middle = n * (2 * k + 1) / (2 * wanted);
    const Result<Flight> pilot =
        fly(cut_out(scene, model, around(*model.cloud, middle)), on_part, registry, path, 1);
    if (!pilot) {
      last = pilot.error();
      continue;
    }
    ++cost.pilots;
    mean.contact_us += pilot->contact_us * pilot->contact_frames;
    mean.contact_frames += pilot->contact_frames;
    mean.bytes += pilot->bytes;
    mean.bytes_said += pilot->bytes_said;
    mean.travel_mm += pilot->travel_mm;
  }
  if (cost.pilots == 0) return last;
  const auto count = static_cast<double>(cost.pilots);
  cost.bytes_share = {mean.bytes_said > 0.0 ? mean.bytes / mean.bytes_said : 1.0};
  if (!(mean.contact_frames > 0.0)) return cost;
  cost.warm_us = mean.contact_us / mean.contact_frames;
  // Over a fine cloud the god object comes to a new point in every frame, over a coarse one seldom.
  const double places = spacing_mm > 0.0 ? std::min(1.0, mean.travel_mm / count / spacing_mm) : 1.0;
  const double waits_ns =
      machine.read_ns(static_cast<double>(said.bytes)) - machine.read_ns(mean.bytes / count);
  cost.miss_us = kReadsPerPlace * places * std::max(0.0, waits_ns) / kNsPerUs;
  cost.frame_us = cost.warm_us + cost.miss_us;
  const std::size_t points = n <= kWholePilotPoints ? n : kPilotPoints;
  cost.reason = fmt::format(
      "{} µs on {} cut-outs of {} points, {} µs of waiting for memory: {} reads at {:.2g} new points a frame",
      short_number(cost.warm_us), cost.pilots, count_text(points), short_number(cost.miss_us), kReadsPerPlace,
      places);
  return cost;
}

}  // namespace

Result<Flight> fly(const render::SceneInput& scene, const NamedOptions& renderer,
                   const render::Registry& registry, const std::string& path_text, int threads) {
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> made,
                 registry.make(renderer.name, renderer.options));
  PALPATE_ASSIGN(const render::Decisions said, made->decide(scene, {threads, nullptr}));
  PALPATE_ASSIGN(const render::PrepareReport report, made->prepare(scene, {threads, nullptr}));
  trace::PathTarget target;
  const render::ModelInput& model = scene.models.front();
  target.cloud = model.cloud.get();
  target.surface = model.analytic.get();
  target.world_from_model = model.world_from_model;
  target.box_mm = target.cloud->box_mm();
  PALPATE_ASSIGN(const NamedOptions generator, parse_named_options(path_text));
  PALPATE_ASSIGN(const trace::ProbePath path, trace::make_path(generator, target));
  PALPATE_ASSIGN(const trace::ForceTrace trace, trace::replay(*made, path, scene.simulation.get()));
  const std::vector<std::uint8_t> contact = trace::contact_of(trace.frames);
  const std::vector<trace::Stretch> stretches = trace::stretches_of(contact);
  std::vector<trace::StretchTime> times(stretches.size());
  trace::Passes passes(*made, path, scene.simulation.get(), trace.frames);
  passes.warm_up(kWarmUpS);
  double fastest_ns = std::numeric_limits<double>::max(), frames = 0.0;
  for (int pass = 0; pass < kPilotPasses; ++pass) {
    PALPATE_TRY(passes.time_stretches(stretches, times));
    double ns = 0.0;
    frames = 0.0;
    for (std::size_t i = 0; i < stretches.size(); ++i) {
      if (!stretches[i].contact) continue;
      ns += static_cast<double>(times[i].cpu_ns);
      frames += static_cast<double>(stretches[i].end - stretches[i].begin);
    }
    fastest_ns = std::min(fastest_ns, ns);
  }
  Flight pilot{frames > 0.0 ? fastest_ns / frames / kNsPerUs : 0.0, frames, static_cast<double>(report.bytes),
               static_cast<double>(said.bytes), 0.0};
  for (std::size_t k = 1; k < path.size(); ++k)
    pilot.travel_mm += (path.hip_mm[k] - path.hip_mm[k - 1]).norm() / static_cast<double>(path.size() - 1);
  return pilot;
}

Result<FrameCost> expect_frame(const render::SceneInput& scene, const NamedOptions& renderer,
                               const render::Decisions& decided, std::span<const double> spacing_mm,
                               const render::Registry& registry, const std::string& path,
                               const Machine& machine) {
  if (decided.models.size() != scene.models.size() || spacing_mm.size() != scene.models.size() ||
      scene.models.empty())
    return Error{"the renderer decided for other models", {}, {}, 0};
  // Of several models the slowest; as many as bound the time that this takes.
  constexpr std::size_t kMostModels = 4;
  FrameCost slowest;
  std::vector<double> bytes_share;
  for (std::size_t i = 0; i < std::min(scene.models.size(), kMostModels); ++i) {
    PALPATE_ASSIGN(FrameCost cost,
                   model_cost(scene, i, renderer, decided, spacing_mm[i], registry, path, machine));
    bytes_share.push_back(cost.bytes_share.front());
    if (cost.frame_us > slowest.frame_us) slowest = std::move(cost);
  }
  slowest.bytes_share = std::move(bytes_share);
  return slowest;
}

}  // namespace palpate::plan
