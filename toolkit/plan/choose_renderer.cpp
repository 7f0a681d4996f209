#include <fmt/format.h>

#include <algorithm>
#include <limits>
#include <memory>
#include <numeric>
#include <utility>
#include <vector>

#include <palpate/geometry.h>
#include <palpate/result.h>
#include "toolkit/cloud/height_field.h"
#include "toolkit/core/messages.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/plan/plan.h"
#include "toolkit/render/prepare.h"
#include "toolkit/spline_sdf/spline_sdf_model.h"

namespace palpate::plan {

using render::Decision;

namespace {

/// Noise of a height grid, in spacings, that is felt: at 0.1 the slope between posts is off by 8 degrees and
/// the force by a sixth.
constexpr double kNoisyHeightsShare = 0.1;
/// From here on triangles between points leave holes and fold (felt_surface, sets tnoise to tn50).
constexpr double kTornShare = 0.2;
/// Pieces along the probe's way are strips, whose borders get fewer bricks than their points suggest: 0.69 to
/// 1.05 of those in a model's middle (nine generated models of 40,000 points without edges: even, random,
/// uneven, noisy), most at density steps. This is the geometric middle.
constexpr double kBricksOfStrips = 0.85;

/// In spacings, or empty if not measurable.
struct Noise {
  double share = 0.0;
  double spacing_mm = 0.0;
  [[nodiscard]] std::string words() const {
    return spacing_mm > 0.0 ? fmt::format("; noise of {:.2g} spacings was measured", share) : "";
  }
};

Noise noise_of(const render::ModelInput& model, const render::PrepareContext& context) {
  const Result<spline_sdf::SplineSdfDecision> measured = spline_sdf::decide_spline_sdf(model, {}, context);
  if (!measured || !(measured->spacing_mm > 0.0)) return {};
  return {measured->noise_mm / measured->spacing_mm, measured->spacing_mm};
}

double largest_stiffness_n_per_mm(const surface::Surface& surface) {
  if (surface.per_point == nullptr || surface.per_point->stiffness_n_per_mm.empty())
    return surface.stiffness_n_per_mm;
  const std::vector<float>& each = surface.per_point->stiffness_n_per_mm;
  return static_cast<double>(*std::max_element(each.begin(), each.end()));
}

/// Decides by the felt step between points: on triangles the force changes by up to stiffness x spacing at
/// edges and in noise. Of eleven shapes under a hand `cloud-smooth` was nearer on 7 to 10 at any noise, lost
/// contact a quarter as often and kicked 4 times against 605 (docs/results/smooth.md, "Which to take"). Below
/// that step `fast` is as good. `facts`: of the points, in words.
Decision choose_by_step(const render::ModelInput& model, const Noise& noise, const std::string& fast,
                        const std::string& facts, const std::string& reason) {
  const double step_n = largest_stiffness_n_per_mm(model.surface) * noise.spacing_mm;
  const std::string step =
      fmt::format("{}{}; at a spacing of {} mm the force moves by {} N from point to point on triangles",
                  facts, noise.words(), format_number(noise.spacing_mm), format_number(step_n));
  if (noise.share >= kTornShare)
    return {"renderer", "cloud-smooth",
            facts + noise.words() +
                ": triangles between such points have holes, a smooth surface near them has none"};
  if (step_n < kPerceptibleForceStepN) return {"renderer", fast, step + ", too little to be felt" + reason};
  return {"renderer", "cloud-smooth",
          step + ", which is felt at edges and in noise, a smooth surface near them is not"};
}

bool has_decision(const render::ModelDecisions& model, const std::string& about) {
  return std::any_of(model.decisions.begin(), model.decisions.end(),
                     [&](const Decision& d) { return d.about == about; });
}

/// Every renderer of points reads stored floats.
void decide_precision(const render::SceneInput& scene, const render::PrepareContext& context, Plan& plan) {
  for (std::size_t i = 0; i < scene.models.size(); ++i) {
    const render::ModelInput& model = scene.models[i];
    const Noise measured = noise_of(model, context);
    plan.spacing_mm.push_back(measured.spacing_mm);
    render::ModelDecisions& estimated = plan.decided.models[i];
    if (!has_decision(estimated, "coordinates"))
      estimated.decisions.push_back(render::coordinates_decision(*model.cloud, measured.spacing_mm));
    if (!render::float_precision_suffices(*model.cloud, measured.spacing_mm))
      plan.warnings.push_back(fmt::format(
          "Single precision is too coarse for {}: a stored coordinate rounds to more than a hundredth of the "
          "spacing. Cut it into several models.",
          model.name));
  }
}

}  // namespace

Decision choose_renderer(const render::SceneInput& scene, const render::PrepareContext& context) {
  if (scene.models.size() != 1) return {"renderer", "cloud", "several models"};
  const render::ModelInput& model = scene.models.front();
  if (model.surface.dent.any() || model.moves != nullptr) return {"renderer", "cloud", "its points give way"};
  const cloud::HeightFieldSummary facts = cloud::summarise_height_field(*model.cloud);
  const Noise noise = noise_of(model, context);
  if (!facts.is) return choose_by_step(model, noise, "cloud", facts.words, ": they are the fastest");
  const double bytes =
      static_cast<double>(sizeof(float) * facts.posts()) / static_cast<double>(model.cloud->size());
  const std::string field = fmt::format("the points are a height field on {}", facts.words);
  const std::string reason = fmt::format(
      "; its answers are nearer and faster than those of cloud, from {:.3g} bytes a point", bytes);
  if (noise.share < kNoisyHeightsShare) return {"renderer", "heightfield", field + noise.words() + reason};
  return choose_by_step(model, noise, "heightfield", field, reason);
}

Result<Plan> make_plan(const render::SceneInput& scene, const std::optional<NamedOptions>& wanted,
                       const render::Registry& registry, const render::PrepareContext& context) {
  if (scene.models.empty()) return Error{"the scene has no model", "add a [[model]]"};
  Plan plan;
  Decision chosen =
      wanted ? Decision{"renderer", wanted->name, "as given", true} : choose_renderer(scene, context);
  plan.renderer = wanted ? *wanted : NamedOptions{chosen.choice, {}};
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                 registry.make(plan.renderer.name, plan.renderer.options));
  PALPATE_ASSIGN(plan.decided, renderer->decide(scene, context));
  decide_precision(scene, context, plan);
  plan.decided.decisions.insert(plan.decided.decisions.begin(), std::move(chosen));
  return plan;
}

void estimate_on_machine(Plan& plan, const render::SceneInput& scene, const render::Registry& registry,
                         const std::string& path, Machine machine) {
  Result<FrameCost> cost =
      estimate_frame_cost({scene, plan.renderer, plan.decided, plan.spacing_mm, path}, registry, machine);
  if (!cost) return;
  plan.decided.bytes = 0;
  for (std::size_t i = 0; i < plan.decided.models.size(); ++i) {
    render::ModelDecisions& model = plan.decided.models[i];
    // Numbers of bricks and refined places depend on the surface.
    if (i < cost->bytes_share.size() && (has_decision(model, "bricks") || has_decision(model, "refined"))) {
      const bool strips = has_decision(model, "bricks") && model.points > kMaxWholePoints;
      const double share = cost->bytes_share[i] / (strips ? kBricksOfStrips : 1.0);
      model.bytes = static_cast<std::uint64_t>(static_cast<double>(model.bytes) * share);
    }
    plan.decided.bytes += model.bytes;
  }
  if (!(cost->frame_us > 0.0)) return;
  // The frame's loop over near models counts in the sum only.
  double of_models = 0.0;
  for (const render::ModelDecisions& model : plan.decided.models)
    of_models = std::max(of_models, model.frame_us.value_or(0.0));
  const double around = plan.decided.frame_us ? std::max(0.0, *plan.decided.frame_us - of_models) : 0.0;
  plan.decided.frame_us = cost->frame_us + around;
  plan.cost = *std::move(cost);
  plan.machine = std::move(machine);
}

namespace {

std::string lines(const std::vector<Decision>& decisions, const char* indent) {
  std::string out;
  for (const Decision& d : decisions)
    out += fmt::format("{}{:<26}{}\n{}{:<26}  {}{}\n", indent, d.about, d.choice, indent, "", d.reason,
                       d.given ? " (given)" : "");
  return out;
}

std::string bytes_or_unknown(std::uint64_t bytes) {
  return bytes > 0 ? "some " + format_bytes(static_cast<double>(bytes)) : "no bytes known beforehand";
}

}  // namespace

std::string text(const Plan& plan) {
  const render::Decisions& decided = plan.decided;
  std::string out = lines(decided.decisions, "");
  for (const render::ModelDecisions& model : decided.models) {
    out +=
        fmt::format("\n{}: {} points, {}{}\n", model.name, format_count(model.points),
                    model.spacing_mm ? fmt::format("spacing {} mm, ", format_number(*model.spacing_mm)) : "",
                    bytes_or_unknown(model.bytes));
    out += lines(model.decisions, "  ");
  }
  out += fmt::format(
      "\nexpected: {} beside the points, {} of preparation, {} a frame in contact ({})\n",
      bytes_or_unknown(decided.bytes),
      decided.prepare_ms ? "some " + format_duration(*decided.prepare_ms) : "a time that was never measured",
      decided.frame_us ? fmt::format("some {} µs", format_number(*decided.frame_us))
                       : "a time that was never measured",
      plan.cost ? "on this machine" : render::kReferenceMachine);
  if (plan.cost) out += fmt::format("frame: {}\n{}\n", plan.cost->reason, text(*plan.machine));
  return out;
}

namespace {

/// Margin around the felt points in spacings: holds rings of neighbours and their borders.
constexpr double kMarginSpacings = 8.0;
/// Fewer points are nearly all border: the margin grows.
constexpr std::size_t kFewestPoints = 1024;
/// More take too long for a plan.
constexpr std::size_t kMaxPoints = 2 * kMaxWholePoints;
/// Stride of HIP places that form the tube: at most a few spacings.
constexpr std::size_t kTubeStride = 8;
/// 2^6 times the margin holds any model, and an eighth of a window still has contact frames.
constexpr int kMaxGrowths = 6, kMaxHalvings = 3;
constexpr std::size_t kWindowFrames = 900;

geometry::Aabb box_around(const std::vector<Vec3>& hips, double margin_mm, bool heights) {
  geometry::Aabb box;
  for (const Vec3& hip : hips) box.add(hip);
  Vec3 margin = Vec3::Constant(margin_mm);
  if (heights) margin.z() = std::numeric_limits<double>::infinity();
  return {box.low_mm - margin, box.high_mm + margin};
}

std::vector<std::uint32_t> inside(const cloud::Cloud& cloud, const geometry::Aabb& box) {
  std::vector<std::uint32_t> of;
  for (std::size_t i = 0; i < cloud.size(); ++i)
    if (box.contains(cloud.local_mm(i))) of.push_back(static_cast<std::uint32_t>(i));
  return of;
}

/// Those of `of` within `radius_mm` of the way.
std::vector<std::uint32_t> tube(const cloud::Cloud& cloud, const std::vector<std::uint32_t>& of,
                                const std::vector<Vec3>& hips, double radius_mm) {
  double gap = 0.0;
  for (std::size_t k = kTubeStride; k < hips.size(); k += kTubeStride)
    gap = std::max(gap, (hips[k] - hips[k - kTubeStride]).norm());
  const double square = (radius_mm + 0.5 * gap) * (radius_mm + 0.5 * gap);
  std::vector<std::uint32_t> kept;
  for (const std::uint32_t i : of) {
    const Vec3 at = cloud.local_mm(i);
    for (std::size_t k = 0; k < hips.size(); k += kTubeStride)
      if ((hips[k] - at).squaredNorm() <= square) {
        kept.push_back(i);
        break;
      }
  }
  return kept;
}

/// The rectangle of a raster that holds these points; nothing if too large.
struct Rectangle {
  std::vector<std::uint32_t> of;
  cloud::ScanRaster raster;
};
Rectangle rectangle_around(const cloud::ScanRaster& raster, const std::vector<std::uint32_t>& of) {
  Rectangle out;
  if (of.empty()) return out;
  std::size_t row0 = raster.rows, row1 = 0, column0 = raster.columns, column1 = 0;
  for (const std::uint32_t i : of) {
    const std::size_t row = i / raster.columns, column = raster.column(i);
    row0 = std::min(row0, row);
    row1 = std::max(row1, row);
    column0 = std::min(column0, column);
    column1 = std::max(column1, column);
  }
  const std::size_t rows = row1 - row0 + 1, columns = column1 - column0 + 1;
  if (rows * columns > kMaxPoints) return out;
  out.raster.rows = static_cast<std::uint32_t>(rows);
  out.raster.columns = static_cast<std::uint32_t>(columns);
  for (std::size_t row = row0; row <= row1; ++row)
    for (std::size_t column = column0; column <= column1; ++column)
      out.of.push_back(static_cast<std::uint32_t>(raster.index(row, column)));
  return out;
}

/// A part of a model, alone and at rest, with its surface.
render::SceneInput part_of(const render::SceneInput& scene, const render::ModelInput& whole,
                           const std::vector<std::uint32_t>& of,
                           const std::optional<cloud::ScanRaster>& raster) {
  render::ModelInput part = render::subset_of(whole, of, raster);
  render::ModelInput model;
  model.name = whole.name;
  model.surface = std::move(part.surface);
  model.cloud = std::move(part.cloud);
  render::SceneInput out;
  out.force_limit_n = scene.force_limit_n;
  out.models.push_back(std::move(model));
  return out;
}

trace::ProbePath part_of(const trace::ProbePath& path, std::size_t begin, std::size_t end) {
  trace::ProbePath out;
  out.name = path.name;
  const auto from = static_cast<std::ptrdiff_t>(begin), to = static_cast<std::ptrdiff_t>(end);
  out.t_s.assign(path.t_s.begin() + from, path.t_s.begin() + to);
  out.hip_mm.assign(path.hip_mm.begin() + from, path.hip_mm.begin() + to);
  return out;
}

/// Points that the way can feel.
std::vector<std::uint32_t> felt_by(const cloud::Cloud& cloud, const std::vector<Vec3>& hips,
                                   const FeltReach& reach) {
  double margin = std::max(kMarginSpacings * reach.spacing_mm, 0.5 * reach.felt_mm);
  std::vector<std::uint32_t> of;
  for (int growth = 0; growth < kMaxGrowths; ++growth, margin *= 2.0) {
    of = inside(cloud, box_around(hips, reach.felt_mm + margin, reach.heights));
    if (of.size() >= std::min(kFewestPoints, cloud.size())) break;
  }
  if (of.size() <= kMaxPoints || reach.heights) return of;
  return tube(cloud, of, hips, reach.felt_mm + margin);
}

}  // namespace

SceneExcerpt extract_excerpt(const render::SceneInput& scene, const render::ModelInput& model,
                             const trace::ProbePath& path, std::size_t begin, std::size_t end,
                             const FeltReach& reach) {
  const cloud::Cloud& cloud = *model.cloud;
  if (cloud.size() <= kMaxWholePoints) {
    std::vector<std::uint32_t> all(cloud.size());
    std::iota(all.begin(), all.end(), 0u);
    return {part_of(scene, model, all, cloud.raster), part_of(path, begin, end)};
  }
  std::vector<std::uint32_t> of;
  for (int halving = 0; halving <= kMaxHalvings; ++halving) {
    std::vector<Vec3> hips;
    for (std::size_t k = begin; k < end; ++k) hips.push_back(path.hip_mm[k] - cloud.origin_mm);
    of = felt_by(cloud, hips, reach);
    if (cloud.raster) {
      Rectangle rectangle = rectangle_around(*cloud.raster, of);
      if (!rectangle.of.empty())
        return {part_of(scene, model, rectangle.of, rectangle.raster), part_of(path, begin, end)};
    }
    if (of.size() <= kMaxPoints) break;
    end = begin + std::max<std::size_t>(1, (end - begin) / 2);
  }
  return {part_of(scene, model, of, std::nullopt), part_of(path, begin, end)};
}

std::vector<Window> choose_windows(std::size_t frames, std::size_t period_frames, std::size_t count) {
  const std::size_t period = period_frames > 0 ? period_frames : kWindowFrames;
  const std::size_t length = period * std::max<std::size_t>(1, kWindowFrames / period);
  const std::size_t fitting = frames / length;
  if (fitting <= 1 || count <= 1) return {{0, frames}};
  std::vector<Window> windows;
  const std::size_t taken = std::min(count, fitting);
  for (std::size_t k = 0; k < taken; ++k) {
    const std::size_t at = (2 * k + 1) * fitting / (2 * taken);
    windows.push_back({at * length, (at + 1) * length});
  }
  return windows;
}

}  // namespace palpate::plan
