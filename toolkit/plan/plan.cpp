#include "toolkit/plan/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <memory>
#include <utility>
#include <vector>

#include "toolkit/cloud/height_field_holes.h"
#include "toolkit/core/numbers.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/render/precision.h"
#include "toolkit/smooth/smooth_model.h"

namespace palpate::plan {

using render::Decision;

namespace {

/// Noise of a grid of heights, in spacings, from which on it is felt: its squares are no steeper than the
/// slope between two posts, and at 0.1 that is off by 8 degrees and the force by a sixth.
constexpr double kNoisyHeightsShare = 0.1;
/// From here on triangles between the points leave holes and fold (felt_surface, sets tnoise to tn50).
constexpr double kTornShare = 0.2;
/// Pieces along the probe's way are strips, and at their borders fewer bricks are built than their points
/// tell of: of what the same surface would get in the middle of a model they hold 0.69 to 1.05 (nine
/// generated models of 40,000 points without edges: even, random, uneven, noisy), most where density steps.
/// This is the middle of these in proportion, so that either end is off alike.
constexpr double kBricksOfStrips = 0.85;

/// In spacings, or none where it could not be measured.
struct Noise {
  double share = 0.0;
  double spacing_mm = 0.0;
  [[nodiscard]] std::string words() const {
    return spacing_mm > 0.0 ? fmt::format("; noise of {:.2g} spacings was measured", share) : "";
  }
};

Noise noise_of(const render::ModelInput& model, const render::PrepareContext& context) {
  const Result<render::SmoothDecision> measured = render::decide_smooth(model, {}, context);
  if (!measured || !(measured->spacing_mm > 0.0)) return {};
  return {measured->noise_mm / measured->spacing_mm, measured->spacing_mm};
}

double largest_stiffness_n_per_mm(const surface::Surface& surface) {
  if (surface.per_point == nullptr || surface.per_point->stiffness_n_per_mm.empty())
    return surface.stiffness_n_per_mm;
  const std::vector<float>& each = surface.per_point->stiffness_n_per_mm;
  return static_cast<double>(*std::max_element(each.begin(), each.end()));
}

/// What a hand feels of points one by one decides: on triangles between them the force moves from point to
/// point by as much as stiffness x spacing, at edges and in noise. Of eleven shapes under a hand
/// `cloud-smooth` was the nearer one on 7 to 10 whatever their noise, lost contact a quarter as often and
/// kicked 4 times for 605 (docs/smooth.md, "Which to take"). Where that step is not felt, `fast` is as good.
/// `facts`: of the points, in words.
Decision choose_by_step(const render::ModelInput& model, const Noise& noise, const std::string& fast,
                        const std::string& facts, const std::string& reason) {
  const double step_n = largest_stiffness_n_per_mm(model.surface) * noise.spacing_mm;
  const std::string step =
      fmt::format("{}{}; at a spacing of {} mm the force moves by {} N from point to point on triangles",
                  facts, noise.words(), short_number(noise.spacing_mm), short_number(step_n));
  if (noise.share >= kTornShare)
    return {"renderer", "cloud-smooth",
            facts + noise.words() +
                ": triangles between such points have holes, a smooth surface near them has none"};
  if (step_n < kFeltForceStepN) return {"renderer", fast, step + ", too little to be felt" + reason};
  return {"renderer", "cloud-smooth",
          step + ", which is felt at edges and in noise, a smooth surface near them is not"};
}

bool says(const render::ModelDecisions& model, const std::string& about) {
  return std::any_of(model.decisions.begin(), model.decisions.end(),
                     [&](const Decision& d) { return d.about == about; });
}

/// Every renderer of points reads the store's floats, whatever it builds of them.
void say_precision(const render::SceneInput& scene, const render::PrepareContext& context, Plan& plan) {
  for (std::size_t i = 0; i < scene.models.size(); ++i) {
    const render::ModelInput& model = scene.models[i];
    const Noise measured = noise_of(model, context);
    plan.spacing_mm.push_back(measured.spacing_mm);
    render::ModelDecisions& said = plan.decided.models[i];
    if (!says(said, "coordinates"))
      said.decisions.push_back(render::coordinates_decision(*model.cloud, measured.spacing_mm));
    if (!render::floats_fit(*model.cloud, measured.spacing_mm))
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
  const cloud::HeightFieldFacts facts = cloud::height_field_facts(*model.cloud);
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
  if (scene.models.empty()) return Error{"the scene has no model", "add a [[model]]", {}, 0};
  Plan plan;
  Decision chosen =
      wanted ? Decision{"renderer", wanted->name, "as given", true} : choose_renderer(scene, context);
  plan.renderer = wanted ? *wanted : NamedOptions{chosen.choice, {}};
  const Result<std::unique_ptr<render::HapticRenderer>> renderer =
      registry.make(plan.renderer.name, plan.renderer.options);
  if (!renderer) return renderer.error();
  Result<render::Decisions> decided = (*renderer)->decide(scene, context);
  if (!decided) return std::move(decided).error();
  plan.decided = *std::move(decided);
  say_precision(scene, context, plan);
  plan.decided.decisions.insert(plan.decided.decisions.begin(), std::move(chosen));
  return plan;
}

void expect_on(Plan& plan, const render::SceneInput& scene, const render::Registry& registry,
               const std::string& path, Machine machine) {
  Result<FrameCost> cost =
      expect_frame({scene, plan.renderer, plan.decided, plan.spacing_mm, path}, registry, machine);
  if (!cost) return;
  plan.decided.bytes = 0;
  for (std::size_t i = 0; i < plan.decided.models.size(); ++i) {
    render::ModelDecisions& model = plan.decided.models[i];
    // Bricks and places of refined triangles are as many as the surface makes of them.
    if (i < cost->bytes_share.size() && (says(model, "bricks") || says(model, "refined"))) {
      const bool strips = says(model, "bricks") && model.points > kWholePilotPoints;
      const double share = cost->bytes_share[i] / (strips ? kBricksOfStrips : 1.0);
      model.bytes = static_cast<std::uint64_t>(static_cast<double>(model.bytes) * share);
    }
    plan.decided.bytes += model.bytes;
  }
  if (!(cost->frame_us > 0.0)) return;
  // What the frame takes for going through models near the HIP stands in the sum alone.
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
  return bytes > 0 ? "some " + bytes_text(static_cast<double>(bytes)) : "no bytes known beforehand";
}

}  // namespace

std::string text(const Plan& plan) {
  const render::Decisions& decided = plan.decided;
  std::string out = lines(decided.decisions, "");
  for (const render::ModelDecisions& model : decided.models) {
    out +=
        fmt::format("\n{}: {} points, {}{}\n", model.name, count_text(model.points),
                    model.spacing_mm ? fmt::format("spacing {} mm, ", short_number(*model.spacing_mm)) : "",
                    bytes_or_unknown(model.bytes));
    out += lines(model.decisions, "  ");
  }
  out += fmt::format(
      "\nexpected: {} beside the points, {} of preparation, {} a frame in contact ({})\n",
      bytes_or_unknown(decided.bytes),
      decided.prepare_ms ? "some " + duration_text(*decided.prepare_ms) : "a time that was never measured",
      decided.frame_us ? fmt::format("some {} µs", short_number(*decided.frame_us))
                       : "a time that was never measured",
      plan.cost ? "on this machine" : render::kExpectedOn);
  if (plan.cost) out += fmt::format("frame: {}\n{}\n", plan.cost->reason, text(*plan.machine));
  return out;
}

}  // namespace palpate::plan
