// The longest frames that a renderer of ours can be brought to, each between marks of its own for
// callgrind: see tests/experiments/worst_frames_test.cpp. Jumps across the model, strokes through it and
// drags along it over points that no surface orders; of all frames those with the most counted steps are
// played once more under the counter.
//
//   worst_frames [POINTS ...]   marks each as NAME SCENE POINTS FRAME BOUND (default: 10000 300000)
#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <cstdio>
#include <memory>
#include <string>
#include <vector>

#include "toolkit/cloud/generate.h"
#include "toolkit/core/instructions.h"
#include "toolkit/core/random.h"
#include "toolkit/heightfield/heightfield_crossing.h"
#include "toolkit/heightfield/heightfield_descent.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"
#include "toolkit/smooth/smooth_contact.h"
#include "toolkit/stars/star_contact.h"

namespace {

using namespace palpate;

constexpr double kPeriodS = 1e-3;
constexpr int kFramesTried = 600;
constexpr std::size_t kCounted = 3;

// Instructions of one unit of a written bound, from above: what callgrind counts on frames that do little
// else. A node: eight boxes at once, then each child's visit and the layer of its block. A triangle: its
// corners read from the ring, its box, six products. A move: the feet on a ring of facets. A value or a
// Newton step of the spline: 64 coefficients, with derivatives. A look at a cell of a height field: its patch
// and the rise over it.
constexpr double kPerNode = 400.0, kPerTriangle = 120.0, kPerMove = 2500.0;
constexpr double kPerNewton = 900.0, kPerValue = 350.0, kPerCube = 150.0;
constexpr double kPerLook = 250.0, kPerSheetMove = 400.0;
/// What any frame takes besides.
constexpr double kPerFrame = 5000.0;

double bound_of(const std::string& name) {
  if (name == "cloud")
    // A flight enters, bridges, and looks for a step of density beyond the gap.
    return kPerFrame + kPerMove * stars::kMaxFacetMoves * stars::kMaxFlights +
           stars::kMaxFlights * 3.0 * (kPerNode * stars::kMaxNodes + kPerTriangle * stars::kMaxTested);
  if (name == "cloud-smooth")
    return kPerFrame + kPerNewton * render::kMaxNewtonSteps * render::kMaxSmoothSheets +
           kPerValue * render::kMaxSegmentValues +
           render::kMaxSmoothEntries * (kPerCube * render::kMaxSegmentCubes);
  return kPerFrame + kPerLook * render::kMaxSegmentLooks + kPerSheetMove * render::kMaxSheetMoves;
}

struct Stand {
  std::string scene;
  std::shared_ptr<const cloud::Cloud> cloud;
};

/// Points anywhere in a cube: no surface, facets in all directions.
Stand soup(std::size_t count) {
  Random random(41);
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < count; ++i)
    points.push_back(
        Vec3{random.uniform(-10.0, 10.0), random.uniform(-10.0, 10.0), random.uniform(-10.0, 10.0)});
  return {"soup", std::make_shared<const cloud::Cloud>(
                      cloud::build_cloud(points, cloud::NonFinite::kRefuse).value())};
}

Stand generated(const char* scene, const std::string& spec) {
  return {scene, std::make_shared<const cloud::Cloud>(
                     cloud::generate(parse_named_options(spec).value()).value().cloud)};
}

std::vector<Stand> stands_of(const std::string& name, std::size_t points) {
  if (name == "heightfield")
    return {generated("relief", fmt::format("relief:points={}:mesh=false:slope=1", points))};
  return {soup(points),
          generated("pebble", fmt::format("pebble:points={}:sampling=random:mesh=false", points)),
          generated("noisy", fmt::format("relief:points={}:sampling=random:noise=0.4:mesh=false", points))};
}

/// Jumps, strokes and drags.
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
    if (kind < 0.4) {  // a jump, out and in
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
  // A step of a walk looks at several facets.
  return 8 * c.walk_steps + c.box_tests + c.cells_visited;
}

struct Tried {
  std::size_t frame = 0;
  std::uint64_t work = 0;
};

/// The frames with the most work, in their order.
std::vector<std::size_t> worst_of(render::HapticRenderer& renderer, const std::vector<Vec3>& path) {
  renderer.restart(path[0], -kPeriodS);
  std::vector<Tried> tried;
  std::uint64_t before = 0;
  for (std::size_t k = 0; k < path.size(); ++k) {
    const render::Frame frame = renderer.step(path[k], kPeriodS * static_cast<double>(k));
    const std::uint64_t now = work_of(renderer.counters());
    // A frame at its bound comes before all others.
    constexpr std::uint64_t kAtBound = std::uint64_t{1} << 32;
    tried.push_back({k, now - before + (frame.status == render::FrameStatus::kBoundHit ? kAtBound : 0)});
    before = now;
  }
  std::partial_sort(tried.begin(), tried.begin() + kCounted, tried.end(),
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
  const std::vector<Vec3> path = wild_path(stand.cloud->box_mm());
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

}  // namespace

int main(int argc, char** argv) {
  std::vector<std::size_t> sizes;
  constexpr NumberRange kSizes{1'000, 20'000'000};
  for (int i = 1; i < argc; ++i) {
    const Result<long long> size = read_integer(argv[i], kSizes);
    if (!size) {
      fmt::print(stderr, "worst_frames: {}\nusage: worst_frames [POINTS ...]\n", size.error().message());
      return 2;
    }
    sizes.push_back(static_cast<std::size_t>(*size));
  }
  if (sizes.empty()) sizes = {10'000, 300'000};
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  for (const std::size_t size : sizes)
    for (const render::RendererInfo& info : registry.all()) {
      if (info.role != render::Role::kOurs) continue;
      for (const Stand& stand : stands_of(info.name, size))
        if (const int status = count(info.name, stand, registry); status != 0) {
          fmt::print(stderr, "worst_frames: {} cannot be prepared on {}\n", info.name, stand.scene);
          return status;
        }
    }
  return 0;
}
