// Longest frames of our renderers, between callgrind marks; see tests/experiments/worst_frames_test.cpp.
// Paths jump across, stroke through and drag over points of no surface; the frames with the most counted
// steps are replayed under the counter.
//
//   worst_frames [RENDERER ...] [POINTS ...]
//
// Marks each as NAME SCENE POINTS FRAME BOUND (default: all our renderers, 10000 300000).
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include <palpate/generate.h>
#include <palpate/registry.h>
#include "toolkit/core/instruction_counter.h"
#include "toolkit/core/random.h"
#include "toolkit/heightfield/heightfield_crossing.h"
#include "toolkit/local_delaunay/mesh_contact.h"
#include "toolkit/spline_sdf/spline_sdf_contact.h"

namespace {

using namespace palpate;

constexpr double kPeriodS = 1e-3;
constexpr int kFramesTried = 600;
constexpr std::size_t kCounted = 3;

// Upper bounds on instructions per unit of a written bound, from callgrind on frames that do little else.
// Node: eight boxes at once, each child's visit and its block's layer. Triangle: corners from the ring, box,
// six products. Move: closest points on a ring of facets. Spline value or Newton step: 64 coefficients with
// derivatives. Height-field cell: its patch and the rise over it.
constexpr double kPerNode = 400.0, kPerTriangle = 120.0, kPerMove = 2500.0;
constexpr double kPerNewton = 900.0, kPerValue = 350.0, kPerCube = 150.0;
constexpr double kPerLook = 250.0, kPerSheetMove = 400.0;
/// Fixed instructions per frame.
constexpr double kPerFrame = 5000.0;

double bound_of(const std::string& name) {
  if (name == "cloud")
    // A flight enters, bridges, and searches for a density step beyond the gap.
    return kPerFrame + kPerMove * local_delaunay::kMaxFacetMoves * local_delaunay::kMaxFlights +
           local_delaunay::kMaxFlights * 3.0 *
               (kPerNode * local_delaunay::kMaxNodes + kPerTriangle * local_delaunay::kMaxTestedTriangles);
  if (name == "cloud-smooth")
    return kPerFrame + kPerNewton * spline_sdf::kMaxNewtonSteps +
           spline_sdf::kMaxEntriesPerFrame *
               (kPerValue * spline_sdf::kMaxSegmentSamples + kPerCube * spline_sdf::kMaxBrickLookups);
  return kPerFrame + kPerLook * heightfield::kMaxCrossingTests +
         kPerSheetMove * heightfield::kMaxDescentMoves;
}

constexpr double kSoupMm = 20.0;  // side of the cube

struct Stand {
  std::string scene;
  std::shared_ptr<const cloud::Cloud> cloud;
  geometry::Aabb around;  ///< the path's region
};

/// Random points in a cube: no surface, facets in all directions.
Stand soup(std::size_t count) {
  Random random(41);
  std::vector<Vec3> points(count);
  const double half = 0.5 * kSoupMm;
  for (Vec3& point : points)
    point = Vec3{random.uniform(-half, half), random.uniform(-half, half), random.uniform(-half, half)};
  return {"soup",
          std::make_shared<const cloud::Cloud>(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value()),
          {Vec3::Constant(-half), Vec3::Constant(half)}};
}

Stand generated(const char* scene, const std::string& spec) {
  auto cloud =
      std::make_shared<const cloud::Cloud>(cloud::generate(parse_named_options(spec).value()).value().cloud);
  const geometry::Aabb around = cloud->box_mm();
  return {scene, std::move(cloud), around};
}

/// Stands are made one at a time.
std::vector<std::function<Stand()>> stands_of(const std::string& name, std::size_t points) {
  if (name == "heightfield")
    return {[=] { return generated("relief", fmt::format("relief:points={}:mesh=false:slope=1", points)); }};
  return {
      [=] { return soup(points); },
      [=] { return generated("pebble", fmt::format("pebble:points={}:sampling=random:mesh=false", points)); },
      [=] {
        return generated("noisy",
                         fmt::format("relief:points={}:sampling=random:noise=0.4:mesh=false", points));
      }};
}

std::vector<Vec3> wild_path(const geometry::Aabb& box) {
  Random random(42);
  const Vec3 middle = box.centre_mm(), half = box.extent_mm().cwiseMax(0.1 * box.extent_mm().maxCoeff());
  const auto anywhere = [&](double reach) {
    const Vec3 at{random.uniform(-reach, reach), random.uniform(-reach, reach),
                  random.uniform(-reach, reach)};
    return Vec3(middle + at.cwiseProduct(half));
  };
  std::vector<Vec3> path = {middle + Vec3{0.0, 0.0, 2.0 * half.norm()}};
  while (path.size() < kFramesTried) {
    const double kind = random.uniform();
    const Vec3 from = path.back();
    if (kind < 0.4) {  // a jump in and out
      path.push_back(anywhere(0.5));
      continue;
    }
    if (kind < 0.5) {
      path.push_back(anywhere(3.0));
      continue;
    }
    const Vec3 to = anywhere(0.7);
    const int steps = 2 + static_cast<int>(random.below(kind < 0.75 ? 8 : 60));
    for (int k = 1; k <= steps; ++k) path.push_back(from + (to - from) * (static_cast<double>(k) / steps));
  }
  return path;
}

std::uint64_t work_of(const render::FrameCounters& c) {
  // A walk step examines several facets.
  return 8 * c.walk_steps + c.box_tests + c.cells_visited;
}

struct Tried {
  std::size_t frame = 0;
  std::uint64_t work = 0;
};

/// Frames with the most work, in order.
std::vector<std::size_t> worst_of(render::HapticRenderer& renderer, const std::vector<Vec3>& path) {
  renderer.restart(path[0], -kPeriodS);
  std::vector<Tried> tried;
  std::uint64_t before = 0;
  for (std::size_t k = 0; k < path.size(); ++k) {
    const render::Frame frame = renderer.step(path[k], kPeriodS * static_cast<double>(k));
    const std::uint64_t now = work_of(renderer.counters());
    // A frame at its bound ranks above all others.
    constexpr std::uint64_t kAtBound = std::uint64_t{1} << 32;
    tried.push_back({k, now - before + (frame.status == render::FrameStatus::kBoundHit ? kAtBound : 0)});
    before = now;
  }
  std::partial_sort(tried.begin(), tried.begin() + static_cast<std::ptrdiff_t>(kCounted), tried.end(),
                    [](const Tried& a, const Tried& b) { return a.work > b.work; });
  std::vector<std::size_t> frames;
  for (std::size_t i = 0; i < kCounted; ++i) frames.push_back(tried[i].frame);
  std::sort(frames.begin(), frames.end());
  return frames;
}

int count(const std::string& name, const Stand& stand, const render::Registry& registry) {
  render::ModelInput model;
  model.cloud = stand.cloud;
  render::SceneInput scene;
  scene.models.push_back(model);
  auto renderer = registry.make(name, {});
  if (!renderer || !(*renderer)->prepare(scene, {1, nullptr})) return 1;
  const std::vector<Vec3> path = wild_path(stand.around);
  const std::vector<std::size_t> worst = worst_of(**renderer, path);
  (*renderer)->restart(path[0], -kPeriodS);
  std::size_t next = 0;
  for (std::size_t k = 0; next < worst.size(); ++k) {
    const double t_s = kPeriodS * static_cast<double>(k);
    if (k != worst[next]) {
      (void)(*renderer)->step(path[k], t_s);
      continue;
    }
    begin_counting();
    (void)(*renderer)->step(path[k], t_s);
    end_counting(
        fmt::format("{} {} {} {} {:.0f}", name, stand.scene, stand.cloud->size(), k, bound_of(name)).c_str());
    ++next;
  }
  return 0;
}

struct Wanted {
  std::vector<std::string> renderers;
  std::vector<std::size_t> sizes;
};

/// Parses the arguments; the first invalid one is an Error.
Result<Wanted> wanted_of(const std::vector<std::string>& words, const render::Registry& registry) {
  constexpr NumberRange kSizes{1'000, 1'000'000};
  Wanted wanted;
  for (const std::string& word : words) {
    if (const render::RendererInfo* info = registry.find(word);
        info != nullptr && info->role == render::Role::kOurs) {
      wanted.renderers.push_back(word);
    } else {
      const Result<long long> size = read_integer(word, kSizes);
      if (!size) return size.error();
      wanted.sizes.push_back(static_cast<std::size_t>(*size));
    }
  }
  if (wanted.sizes.empty()) wanted.sizes = {10'000, 300'000};
  if (wanted.renderers.empty())
    for (const render::RendererInfo& info : registry.all())
      if (info.role == render::Role::kOurs && info.geometry != render::Geometry::kImages)
        wanted.renderers.push_back(info.name);
  return wanted;
}

}  // namespace

int main(int argc, char** argv) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  const Result<Wanted> wanted = wanted_of({argv + 1, argv + argc}, registry);
  if (!wanted) {
    fmt::print(stderr,
               "worst_frames: {}\nusage: worst_frames [RENDERER ...] [POINTS ...]\n"
               "  a renderer of ours: cloud, cloud-smooth, heightfield\n",
               wanted.error().message());
    return 2;
  }
  for (const std::size_t size : wanted->sizes)
    for (const std::string& name : wanted->renderers)
      for (const auto& stand : stands_of(name, size))
        if (const int status = count(name, stand(), registry); status != 0) {
          fmt::print(stderr, "worst_frames: {} was not counted at {} points\n", name, size);
          return status;
        }
  return 0;
}
