// What ideas of the frame of `cloud-smooth` save: the same frames with one of them undone before each frame,
// and the spline with its rows one number at a time. Functions are named so that callgrind tells them apart:
// see idea_costs. Each runs once; nothing is timed.
#include <fmt/format.h>

#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "toolkit/cloud/generate.h"
#include "toolkit/smooth/smooth_contact.h"
#include "toolkit/smooth/smooth_model.h"
#include "toolkit/trace/paths.h"

#if defined(__clang__)
#define PALPATE_COUNTED __attribute__((noinline))
#else
#define PALPATE_COUNTED __attribute__((noinline, no_icf))
#endif

namespace palpate::benchmarks {
namespace {

constexpr const char* kPoints = "torus:sampling=random:points=30000:mesh=false:seed=7";
constexpr const char* kPath = "weave:frames=9000:depth_mm=1:clearance_mm=1:period_frames=450:seed=5";
/// Where the god object is put down again: so much outside of it, in voxels.
constexpr double kOutside = 0.3;

/// `kKeeps`: what the frames before left is used.
template <bool kKeeps>
PALPATE_COUNTED bool idea_smooth_contact_frame(render::SmoothContact& contact, const Vec3& h,
                                               const Vec3& outside, render::FrameCounters& counters) {
  if constexpr (!kKeeps) contact.start_from(outside);
  return contact.update(h, counters);
}
PALPATE_COUNTED bool idea_smooth_flat_frame(render::SmoothContact& contact, const Vec3& h,
                                            render::FrameCounters& counters) {
  return contact.update(h, counters);
}
template <bool kKeeps>
PALPATE_COUNTED bool idea_smooth_free_frame(render::SmoothContact& contact, const Vec3& h, const Vec3& before,
                                            render::FrameCounters& counters) {
  if constexpr (!kKeeps) contact.start_from(before);
  return contact.update(h, counters);
}

struct Pass {
  Vec3 sum = Vec3::Zero();
  int in = 0, out = 0;
};
/// `kExact`: steps with the exact Hessian; else with that of a plane.
template <bool kWarm, bool kClear, bool kExact = true>
Pass one_pass(const render::BrickGrid& grid, const std::vector<Vec3>& hip) {
  render::SmoothContact contact;
  contact.attach(grid);
  render::SmoothWithout without;
  without.hessian = !kExact;
  contact.leave_out(without);
  contact.restart(hip[0]);
  render::FrameCounters counters;
  Pass pass;
  Vec3 before = hip[0];
  for (const Vec3& h : hip) {
    const bool was = contact.contact();
    bool is = false;
    if (was) {
      const Vec3 g = contact.god_object_mm(), pull = g - before;
      const Vec3 outside = pull.norm() > 0.0 ? Vec3(g + pull.normalized() * (kOutside * grid.voxel_mm)) : g;
      if constexpr (kExact)
        is = idea_smooth_contact_frame<kWarm>(contact, h, outside, counters);
      else
        is = idea_smooth_flat_frame(contact, h, counters);
    } else {
      is = idea_smooth_free_frame<kClear>(contact, h, before, counters);
    }
    ++(was ? pass.in : pass.out);
    if (is) pass.sum += contact.god_object_mm() - h;
    before = h;
  }
  return pass;
}

/// The weights of a cubic B-spline along one axis.
std::array<float, 4> plain_weights(float t) {
  const float s = 1.0f - t;
  return {s * s * s / 6.0f, 2.0f / 3.0f - t * t * (1.0f - 0.5f * t), 2.0f / 3.0f - s * s * (1.0f - 0.5f * s),
          t * t * t / 6.0f};
}
/// The value of the spline as its formula has it.
PALPATE_COUNTED double idea_spline_plain(const render::Brick& brick, const render::BrickPlace& at) {
  const std::array<float, 4> x = plain_weights(at.t[0]), y = plain_weights(at.t[1]),
                             z = plain_weights(at.t[2]);
  double sum = 0.0;
  for (std::size_t i = 0; i < 4; ++i)
    for (std::size_t j = 0; j < 4; ++j)
      for (std::size_t k = 0; k < 4; ++k) {
        const std::size_t row = (static_cast<std::size_t>(at.cell[0]) + i) * render::kBrickNodes +
                                static_cast<std::size_t>(at.cell[1]) + j;
        const std::size_t index = row * render::kBrickNodes + static_cast<std::size_t>(at.cell[2]) + k;
        sum += static_cast<double>(x[i] * y[j] * z[k]) * static_cast<double>(brick.distance[index]);
      }
  return sum * static_cast<double>(render::kBrickUnit);
}
PALPATE_COUNTED double idea_spline_lanes(const render::Brick& brick, const render::BrickPlace& at) {
  return static_cast<double>(render::spline_value(brick, at));
}

/// Whether plain and lanes say the same.
bool compare_splines(const render::BrickGrid& grid) {
  constexpr double kFloatRounding = 1e-5;
  for (std::size_t i = 0; i < 1000; ++i) {
    render::BrickPlace at;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      at.cell[axis] = static_cast<int>((i >> axis) % 4);
      at.t[axis] = static_cast<float>(i % 7) / 7.0f;
    }
    const render::Brick& brick = grid.bricks[i * 31 % grid.bricks.size()];
    if (std::abs(idea_spline_plain(brick, at) - idea_spline_lanes(brick, at)) > kFloatRounding) return false;
  }
  return true;
}

int run() {
  auto made = cloud::generate(parse_named_options(kPoints).value()).value();
  trace::PathTarget target;
  target.surface = made.surface.get();
  target.box_mm = made.surface->box_mm();
  const auto path = trace::make_path(parse_named_options(kPath).value(), target).value();
  render::ModelInput input;
  input.cloud = std::make_shared<const cloud::Cloud>(made.cloud);
  render::PrepareReport report;
  const auto body = render::build_smooth_body(input, {}, {1, nullptr}, report);
  if (!body) return 1;
  const render::BrickGrid& grid = body->smooth->grid;
  std::vector<Vec3> hip;
  for (const Vec3& h : path.hip_mm) hip.push_back(body->pose.to_local(h));
  const Pass all = one_pass<true, true>(grid, hip), cold = one_pass<false, true>(grid, hip),
             unclear = one_pass<true, false>(grid, hip), flat = one_pass<true, true, false>(grid, hip);
  // The god object comes to the same place from wherever it is put down, to what a settled step leaves of it.
  constexpr double kSettled = 1e-3;
  // Such steps grow smaller by a share each: what is left after a settled one is some of its hundredth voxel.
  const double flat_settled = 0.01 * grid.voxel_mm;
  const bool same = (cold.sum - all.sum).norm() < kSettled * static_cast<double>(all.in) &&
                    unclear.sum == all.sum && cold.in == all.in &&
                    (flat.sum - all.sum).norm() < flat_settled * static_cast<double>(all.in) &&
                    flat.in == all.in && compare_splines(grid);
  fmt::print("{} frames from contact, {} from free air, 1000 values\n", all.in, all.out);
  if (!same) fmt::print(stderr, "smooth_ideas: frames are others where an idea is undone\n");
  return same ? 0 : 1;
}

}  // namespace
}  // namespace palpate::benchmarks

int main() {
  return palpate::benchmarks::run();
}
