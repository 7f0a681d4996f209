#include "toolkit/plan/plan.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "toolkit/cloud/height_field_holes.h"
#include "toolkit/core/numbers.h"
#include "toolkit/core/tolerances.h"
#include "toolkit/neighbourhood/knn.h"
#include "toolkit/neighbourhood/spacing.h"
#include "toolkit/points/point_model.h"

namespace palpate::plan {
namespace {

// Measured on kPlanHardware; they say what to expect, no decision rests on them. Frames in contact:
// bench_frame at 1,002,001 points, and feature_costs, whose differences are over all frames of a path that is
// in contact for 73 % of them. Preparation on two threads: reproduce.
constexpr double kCloudFrameUs = 0.25;
constexpr double kHeightFieldFrameUs = 0.10;
constexpr double kFrictionUs = 0.05, kVariedUs = 0.02, kTextureUs = 0.11, kSceneUs = 0.02;
constexpr double kScanOrderMsPerMillion = 450.0;  // neighbours known, grid, planes, sides
constexpr double kSearchMsPerMillion = 900.0;     // neighbours searched
constexpr double kHeightFieldMsPerMillion = 45.0;

/// Coordinates are floats relative to the middle of the box: they round to 2^-25 of the extent. A hundredth
/// of the spacing moves no point past another and no normal by more than half a degree.
constexpr double kFloatShare = 0.01;

/// A grid slot is 16 bytes, at most four slots an occupied cell, some 25 points a cell of 5 resolutions.
constexpr double kGridBytesPerPoint = 16.0 * 4.0 / 25.0;

bool is_flat_choice(const NamedOptions& renderer) {
  return renderer.name.starts_with("heightfield");
}

/// As printed, and where it is asked for, nothing is filled.
bool fills_gaps(const NamedOptions& renderer) {
  return renderer.name == "heightfield" &&
         (!renderer.options.has("holes") || renderer.options.text("holes") == "fill");
}

Decision holes_decision(const cloud::HeightFieldFacts& facts, const NamedOptions& renderer) {
  const std::size_t open = facts.holes.missing - (fills_gaps(renderer) ? facts.holes.gaps : 0);
  return {"holes",
          facts.holes.missing == 0 ? "none"
          : open == 0              ? "filled"
                                   : fmt::format("open, {} posts", open),
          "it is " + facts.words, renderer.options.has("holes")};
}

Decision neighbours_decision(const cloud::Cloud& cloud, const NamedOptions& renderer) {
  if (is_flat_choice(renderer))
    return {"neighbours", "none stored", "the neighbours of a post are known from its column and row"};
  if (renderer.options.has("neighbours"))
    return {"neighbours", renderer.options.text("neighbours"), "as given", true};
  if (cloud.raster)
    return {"neighbours", "scanner-path",
            fmt::format("the points stand in a scanner's order, {} rows of {}: nothing has to be searched",
                        cloud.raster->rows, cloud.raster->columns)};
  return {"neighbours", "modified-knn", "the order of the points says nothing about neighbours"};
}

Decision shading_decision(double stiffness, double spacing_mm, const NamedOptions& renderer) {
  if (renderer.options.has("shading")) return {"shading", renderer.options.text("shading"), "as given", true};
  if (is_flat_choice(renderer))
    return {"shading", "none", "the god object moves over the bilinear surface without steps"};
  const double step = stiffness * spacing_mm;
  if (step > kFeltForceStepN)
    return {
        "shading", "facet, where a point's spacing asks for it",
        fmt::format("a change of point moves the force by up to {:.3g} N/mm x {:.3g} mm = {:.3g} N, and {} N "
                    "is felt",
                    stiffness, spacing_mm, step, kFeltForceStepN)};
  return {"shading", "none",
          fmt::format("a change of point moves the force by at most {:.3g} N, below the {} N that is felt",
                      step, kFeltForceStepN)};
}

Decision coordinates_decision(const cloud::Cloud& cloud, double nearest_mm) {
  const double rounding = cloud.box_mm().extent_mm().maxCoeff() * kUnitRoundoffFloat * 0.5;
  const bool fits = nearest_mm <= 0.0 || rounding <= kFloatShare * nearest_mm;
  return {"coordinates", "float, relative to the middle of the box",
          fmt::format("they round to {:.2g} mm, {:.2g} of the median spacing{}", rounding,
                      nearest_mm > 0.0 ? rounding / nearest_mm : 0.0,
                      fits ? "" : ": TOO COARSE, cut the cloud into several models")};
}

/// One decision on a property that may be absent, uniform or per point.
Decision property(const char* name, bool any, bool per_point, const std::string& value, std::uint64_t points,
                  std::uint64_t bytes_each) {
  if (per_point)
    return {
        name, "per point",
        fmt::format("it differs from point to point: {} bytes for each of {} points", bytes_each, points)};
  if (any) return {name, "one value, " + value, "it is the same all over the model: no byte per point"};
  return {name, "none",
          "the scene asks for none: its stage is not in the frame function, and no byte is stored"};
}

void add_surface(const render::ModelInput& model, ModelPlan& plan) {
  const surface::Surface& s = model.surface;
  const surface::PointProperties* p = model.surface.per_point.get();
  const bool varies_friction = p != nullptr && p->varies_friction();
  const bool varies_stiffness = p != nullptr && p->varies_stiffness();
  constexpr std::uint64_t kEach = sizeof(render::PlaceSurface);
  plan.decisions.push_back(
      property("friction", s.friction.any(), varies_friction,
               fmt::format("static {:.3g}, dynamic {:.3g}", s.friction.static_coefficient,
                           s.friction.dynamic_coefficient),
               plan.points, kEach));
  plan.decisions.push_back(property("stiffness and deformation", true, varies_stiffness,
                                    fmt::format("{:.3g} N/mm", s.stiffness_n_per_mm * (1.0 - s.deformation)),
                                    plan.points, kEach));
  plan.decisions.push_back(
      property("texture", s.texture.any(), false,
               fmt::format("{:.3g} mm deep over {:.3g} mm", s.texture.depth_mm, s.texture.wavelength_mm),
               plan.points, 0));
  if (varies_friction || varies_stiffness) plan.bytes += kEach * plan.points;
}

Result<ModelPlan> plan_model(const render::ModelInput& model, const NamedOptions& renderer, int threads) {
  const cloud::Cloud& cloud = *model.cloud;
  ModelPlan plan;
  plan.name = model.name;
  plan.points = cloud.size();
  const bool flat = is_flat_choice(renderer);
  if (flat) {
    const cloud::HeightFieldFacts facts = cloud::height_field_facts(cloud, fills_gaps(renderer));
    if (!facts.is) return Error{facts.words, "use the renderer cloud", {}, 0};
    plan.bytes = sizeof(float) * facts.posts();
    plan.decisions.push_back(holes_decision(facts, renderer));
  }
  const neighbourhood::NeighbourTable nearest = neighbourhood::exact_knn(cloud, threads);
  const neighbourhood::Spacing spacing = neighbourhood::describe_spacing(cloud, nearest);
  plan.spacing_mm = spacing.resolution_mm;
  if (!flat)
    plan.bytes = static_cast<std::uint64_t>(
        (sizeof(render::StoredPoint) + sizeof(neighbourhood::Neighbours) + kGridBytesPerPoint) *
        static_cast<double>(plan.points));
  plan.decisions.push_back(neighbours_decision(cloud, renderer));
  if (!flat)
    plan.decisions.push_back(
        {"partition", renderer.options.has("partition") ? renderer.options.text("partition") : "grid",
         fmt::format("cells of {:.3g} mm, five times the resolution; memory follows the occupied ones",
                     kCellPerResolution * plan.spacing_mm),
         renderer.options.has("partition")});
  plan.decisions.push_back(shading_decision(model.surface.stiffness_n_per_mm, plan.spacing_mm, renderer));
  plan.decisions.push_back(coordinates_decision(cloud, spacing.nearest_mm.p50));
  add_surface(model, plan);
  if (model.surface.dent.any() || model.moves != nullptr) {
    constexpr std::uint64_t kKept = sizeof(render::StoredPoint) + sizeof(neighbourhood::Neighbours) + 12;
    plan.bytes += kKept * plan.points;
    plan.decisions.push_back({"deformable geometry", "moving grid, first shape kept",
                              fmt::format("points move with their links: some {} bytes more for each", kKept),
                              true});
  }
  if (model.motion != nullptr)
    plan.decisions.push_back({"motion", "pose read in each frame", "the scene moves it", true});
  return plan;
}

void expect(const render::SceneInput& scene, Plan& plan) {
  bool friction = false, varied = false, texture = false;
  for (const render::ModelInput& model : scene.models) {
    friction |= model.surface.friction.any();
    texture |= model.surface.texture.any();
    varied |= model.surface.per_point != nullptr;
  }
  const bool flat = is_flat_choice(plan.renderer);
  plan.prepare_ms = 0.0;
  for (const render::ModelInput& model : scene.models) {
    const double each = flat                              ? kHeightFieldMsPerMillion
                        : model.cloud->raster.has_value() ? kScanOrderMsPerMillion
                                                          : kSearchMsPerMillion;
    plan.prepare_ms += each * 1e-6 * static_cast<double>(model.cloud->size());
  }
  plan.frame_us = (flat ? kHeightFieldFrameUs : kCloudFrameUs) + (friction ? kFrictionUs : 0.0) +
                  (varied ? kVariedUs : 0.0) + (texture ? kTextureUs : 0.0);
  const bool moves = scene.simulation != nullptr;
  const bool many = scene.models.size() > 1;
  if (many || moves) plan.frame_us += kSceneUs;
  plan.decisions.push_back(
      many || moves ? Decision{"broad phase", "tree of model boxes",
                               fmt::format("{} models{}: a frame looks only at those near the HIP",
                                           scene.models.size(), moves ? ", some of them moving" : "")}
                    : Decision{"broad phase", "none", "one model at rest: there is nothing to choose from"});
}

}  // namespace

Decision choose_renderer(const render::SceneInput& scene) {
  if (scene.models.size() != 1) return {"renderer", "cloud", "several models"};
  const render::ModelInput& model = scene.models.front();
  if (model.surface.dent.any() || model.moves != nullptr) return {"renderer", "cloud", "its points give way"};
  const cloud::HeightFieldFacts facts = cloud::height_field_facts(*model.cloud);
  if (!facts.is) return {"renderer", "cloud", facts.words};
  return {"renderer", "heightfield",
          fmt::format(
              "the points are a height field on {}; its answers are nearer and faster than those of "
              "cloud, from {:.3g} bytes a point",
              facts.words,
              static_cast<double>(sizeof(float) * facts.posts()) / static_cast<double>(model.cloud->size()))};
}

Result<Plan> make_plan(const render::SceneInput& scene, const std::optional<NamedOptions>& wanted,
                       int threads) {
  if (scene.models.empty()) return Error{"the scene has no model", "add a [[model]]", {}, 0};
  Plan plan;
  if (wanted) {
    plan.renderer = *wanted;
    plan.decisions.push_back({"renderer", wanted->name, "as given", true});
  } else {
    plan.decisions.push_back(choose_renderer(scene));
    plan.renderer.name = plan.decisions.back().choice;
  }
  for (const render::ModelInput& model : scene.models) {
    Result<ModelPlan> one = plan_model(model, plan.renderer, threads);
    if (!one) return std::move(one).error();
    plan.bytes += one->bytes;
    plan.models.push_back(*std::move(one));
  }
  expect(scene, plan);
  plan.decisions.push_back(
      scene.force_limit_n > 0.0
          ? Decision{"force limit", fmt::format("{:.3g} N", scene.force_limit_n), "the scene sets it", true}
          : Decision{"force limit", "none", "the scene sets none; a device has its own"});
  return plan;
}

std::string text(const Plan& plan) {
  std::string out;
  const auto lines = [&](const std::vector<Decision>& decisions, const char* indent) {
    for (const Decision& d : decisions)
      out += fmt::format("{}{:<26}{}\n{}{:<26}  {}{}\n", indent, d.about, d.choice, indent, "", d.reason,
                         d.given ? " (given)" : "");
  };
  lines(plan.decisions, "");
  for (const ModelPlan& model : plan.models) {
    out += fmt::format("\n{}: {} points, spacing up to {} mm, {}\n", model.name, count_text(model.points),
                       short_number(model.spacing_mm), bytes_text(static_cast<double>(model.bytes)));
    lines(model.decisions, "  ");
  }
  out += fmt::format("\nexpected: {} beside the points, {} of preparation, {} µs a frame in contact ({})\n",
                     bytes_text(static_cast<double>(plan.bytes)), duration_text(plan.prepare_ms),
                     short_number(plan.frame_us), kPlanHardware);
  return out;
}

}  // namespace palpate::plan
