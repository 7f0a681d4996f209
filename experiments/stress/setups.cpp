#include "experiments/stress/setups.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include <palpate/generate.h>
#include <palpate/result.h>
#include "toolkit/core/tolerances.h"

namespace palpate::experiments {
namespace {

constexpr double kPeriodS = 1e-3;

StressSetup setup_of(render::ModelInput model) {
  model.surface.stiffness_n_per_mm = kStressStiffness;
  StressSetup setup;
  setup.scene.force_limit_n = kStressLimitN;
  setup.scene.models.push_back(std::move(model));
  return setup;
}

/// A power of two scales stored coordinates exactly; other stretches store the points anew.
Result<cloud::Cloud> moved_cloud(const cloud::Cloud& cloud, const Stretch& stretch, bool exact) {
  if (exact) {
    cloud::Cloud scaled = cloud;
    scaled.origin_mm *= stretch.scale;
    const auto by = static_cast<float>(stretch.scale);
    for (std::vector<float>* axis : {&scaled.x_mm, &scaled.y_mm, &scaled.z_mm})
      for (float& value : *axis) value *= by;
    return scaled;
  }
  std::vector<Vec3> points(cloud.size());
  for (std::size_t i = 0; i < points.size(); ++i)
    points[i] = stretch.scale * cloud.point_mm(i) + stretch.offset_mm;
  return cloud::build_cloud(points, cloud::NonFinite::kRefuse);
}

std::shared_ptr<const geometry::TriangleMesh> moved_mesh(const geometry::TriangleMesh& mesh,
                                                         const Stretch& stretch) {
  auto moved = std::make_shared<geometry::TriangleMesh>(mesh);
  for (Vec3& vertex : moved->vertices_mm) vertex = stretch.scale * vertex + stretch.offset_mm;
  return moved;
}

/// Bound on the placement error of points and HIP in the stretched scene, at unit scale. Contributions:
/// forming each (u times its size); storing a point (half the extent times float's unit roundoff, at both
/// scales); bringing the HIP into the model frame (nine products and a translation: gamma(6) of its size).
double placement_error(const cloud::Cloud& cloud, const Stretch& stretch, bool stored_anew) {
  const geometry::Aabb box = cloud.box_mm();
  const double reach = std::max(box.low_mm.cwiseAbs().maxCoeff(), box.high_mm.cwiseAbs().maxCoeff());
  const double size = stretch.scale * reach + stretch.offset_mm.norm() + stretch.pose.translation_mm.norm();
  constexpr int kOperations = 12;  // forming it, into the world and back
  const double rounded = std::sqrt(3.0) * gamma(kOperations) * size / stretch.scale;
  const double stored = std::sqrt(3.0) * 2.0 * kUnitRoundoffFloat * 0.5 * box.extent_mm().maxCoeff();
  return rounded + (stored_anew ? stored : 0.0);
}

bool is_power_of_two(double value) {
  int exponent = 0;
  return std::frexp(value, &exponent) == 0.5;
}

}  // namespace

Result<StressSetup> setup_of_points(const std::vector<Vec3>& points, const std::string& name) {
  render::ModelInput model;
  model.name = name;
  PALPATE_ASSIGN(cloud::Cloud cloud, cloud::build_cloud(points, cloud::NonFinite::kRefuse));
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(cloud));
  return setup_of(std::move(model));
}

Result<StressSetup> setup_of_generator(const std::string& generator) {
  PALPATE_ASSIGN(const NamedOptions spec, parse_named_options(generator));
  PALPATE_ASSIGN(cloud::GeneratedModel made, cloud::generate(spec));
  render::ModelInput model;
  model.name = generator;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(made.cloud));
  model.original_mesh = made.original_mesh;
  model.analytic = made.surface;
  return setup_of(std::move(model));
}

MakeSetup on(std::function<Points()> points, const char* name, Change change) {
  return [=]() -> Result<StressSetup> {
    PALPATE_ASSIGN(StressSetup setup, setup_of_points(points(), name));
    change(setup);
    return setup;
  };
}

MakeSetup on(const char* generator, Change change) {
  return [=]() -> Result<StressSetup> {
    PALPATE_ASSIGN(StressSetup setup, setup_of_generator(generator));
    change(setup);
    return setup;
  };
}

Way& Way::to(const Vec3& place, int steps, const std::function<Due(const Vec3&)>& due) {
  const Vec3 from = at_;
  for (int i = 1; i <= steps; ++i) {
    at_ = i == steps ? place : Vec3(from + (static_cast<double>(i) / steps) * (place - from));
    path_.t_s.push_back(now_s_);
    path_.hip_mm.push_back(at_);
    due_.push_back(due(at_));
    now_s_ += kPeriodS;
  }
  return *this;
}

Way& Way::to(const Vec3& place, int steps, Due due) {
  return to(place, steps, [due](const Vec3&) { return due; });
}

Way& Way::stay(int frames, Due due) {
  for (int i = 0; i < frames; ++i) to(at_, 1, due);
  return *this;
}

void Way::put_into(StressSetup& setup) && {
  setup.path = std::move(path_);
  setup.path.name = "stress";
  setup.due = std::move(due_);
}

Change along(const Vec3& start, std::function<void(Way&)> go) {
  return [=](StressSetup& setup) {
    Way way(start);
    go(way);
    std::move(way).put_into(setup);
  };
}

void weave(StressSetup& setup, double out_mm, double deep_mm, double clear_mm, double felt_mm, int frames) {
  const geometry::AnalyticSurface& surface = *setup.scene.models.front().analytic;
  constexpr double kPi = std::numbers::pi;
  constexpr int kTimes = 3;
  const double middle = 0.5 * (out_mm - deep_mm), half = 0.5 * (out_mm + deep_mm);
  setup.path = {};
  setup.due.clear();
  setup.path.name = "stress";
  for (int k = 0; k <= frames; ++k) {
    const double along = static_cast<double>(k) / frames;
    const geometry::SurfacePoint at = surface.at(0.5 + 0.2 * std::sin(2.0 * kPi * along + 0.3),
                                                 0.5 + 0.2 * std::cos(2.0 * kPi * std::numbers::phi * along));
    const double height = middle + half * std::cos(2.0 * kPi * kTimes * along);
    const Vec3 hip = at.point_mm + height * at.normal;
    setup.path.t_s.push_back(kPeriodS * k);
    setup.path.hip_mm.push_back(hip);
    const double distance = surface.signed_distance_mm(hip);
    setup.due.push_back(distance > clear_mm ? Due::kFree : distance < -felt_mm ? Due::kInside : Due::kAny);
  }
}

void dip(StressSetup& setup, const Dip& d) {
  const Vec3 out(0, 0, d.out_mm), deep(0, 0, -d.deep_mm);
  const double floor = d.from.z();
  const auto due = [&](const Vec3& p) {
    const double height = p.z() - floor;
    return height > d.clear_mm ? Due::kFree : height < -d.felt_mm ? Due::kInside : Due::kAny;
  };
  Way way(d.from + out);
  way.to(d.from + deep, d.frames, due).to(d.to + deep, d.frames, due).to(d.to + out, d.frames, due);
  way.stay(3, d.out_mm > d.clear_mm ? Due::kFree : Due::kAny);
  std::move(way).put_into(setup);
}

Change dipping(const Dip& d) {
  return [d](StressSetup& setup) { dip(setup, d); };
}

void let_nothing_be_due(StressSetup& setup) {
  std::replace(setup.due.begin(), setup.due.end(), Due::kInside, Due::kAny);
}

Result<StressSetup> stretched(const std::shared_ptr<const StressSetup>& unit, const Stretch& stretch) {
  StressSetup setup = *unit;
  render::ModelInput& model = setup.scene.models.front();
  const cloud::Cloud& cloud = *model.cloud;
  const std::string generator = model.name;
  const bool only_scaled = stretch.offset_mm == Vec3::Zero();
  const bool exact = is_power_of_two(stretch.scale) && only_scaled;
  PALPATE_ASSIGN(cloud::Cloud moved, moved_cloud(cloud, stretch, exact));
  moved.raster = cloud.raster;
  const double error = placement_error(cloud, stretch, !exact);
  if (model.original_mesh) model.original_mesh = moved_mesh(*model.original_mesh, stretch);
  if (model.analytic && stretch.scale != 1.0) {
    model.analytic = nullptr;
    PALPATE_ASSIGN(NamedOptions spec, parse_named_options(generator));
    spec.options.set("scale", fmt::format("{}", stretch.scale));
    PALPATE_ASSIGN(const cloud::GeneratedModel made, cloud::generate(spec));
    model.analytic = made.surface;
  }
  if (!only_scaled) model.analytic = nullptr;
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(moved));
  model.world_from_model = stretch.pose;
  model.surface.stiffness_n_per_mm = unit->scene.models.front().surface.stiffness_n_per_mm / stretch.scale;
  for (Vec3& hip : setup.path.hip_mm) hip = stretch.pose * Vec3(stretch.scale * hip + stretch.offset_mm);
  setup.twin = unit;
  if (exact && stretch.pose.is_identity()) return setup;
  // A facet with corners displaced by `error` moves as much and turns by up to twice that over its least
  // height, which sampling keeps above a quarter of the spacing. The closest point of a HIP at depth d moves
  // by error (1 + 2 d / height), and the HIP by `error` again.
  const double spacing =
      std::sqrt(cloud.box_mm().extent_mm().head<2>().prod() / static_cast<double>(cloud.size()));
  constexpr double kLeastHeight = 0.25, kDeepest = 2.0;  // kDeepest, mm: greatest depth of stretched paths
  setup.twin_n_per_mm = unit->scene.models.front().surface.stiffness_n_per_mm *
                        (2.0 + 2.0 * kDeepest / (kLeastHeight * spacing));
  setup.twin_bound_n = setup.twin_n_per_mm * error;
  return setup;
}

}  // namespace palpate::experiments
