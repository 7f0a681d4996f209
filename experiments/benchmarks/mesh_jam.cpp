// The full jam test: mesh renderers on table 7's sinusoid of 2 million triangles. Each row has the god
// object's distance from the mesh's closest point along the path, the frame time, and the failed stops. At a
// failed stop the held probe reaches no rest, or one that the touched facets cannot support.
//
//   mesh_jam [POINTS [STOPS [RENDERER..]]]      1002001 100 mesh-godobject mesh-proxy:..
#include <fmt/format.h>

#include <cmath>
#include <cstdlib>
#include <memory>
#include <string>
#include <vector>

#include <palpate/baselines.h>
#include <palpate/registry.h>
#include <palpate/replay.h>
#include "baselines/reference/facet_tree.h"
#include "baselines/renderers/mesh_source.h"
#include "experiments/benchmarks/generated_scene.h"

namespace palpate {
namespace {

/// Calls allowed per stop; the open library that this test comes from needed no more.
constexpr double kStepS = 1e-3;  // the servo's period
constexpr int kMostCalls = 20'000;
/// Identical answers that make a rest.
constexpr int kRestCalls = 3;
/// Pull direction error that makes a jam; rounding gives some 1e-8, the open library 37 degrees.
constexpr double kMostOffRad = 1e-6;
/// Distance at which facets hold the proxy's skin: far above rounding, far below a facet's size.
constexpr double kReachMm = 1e-9;
/// Approach to the path's first sample.
constexpr int kApproachFrames = 200;
constexpr double kApproachMm = 10.0;

struct Ground {
  render::SceneInput scene;
  trace::ProbePath path;
  baselines::SurfaceMesh mesh;
  std::unique_ptr<baselines::FacetTree> tree;
  std::vector<Vec3> closest;  ///< on the mesh, for every path sample, relative to the mesh's origin
};

/// Prepends an approach from afar: the path begins nearer to the surface than a sphere's radius.
trace::ProbePath approached(const trace::ProbePath& path, const geometry::AnalyticSurface& surface) {
  trace::ProbePath result;
  result.name = path.name;
  const Vec3 end = path.hip_mm.front(), out = surface.closest(end).normal;
  for (int i = 0; i < kApproachFrames; ++i) {
    result.t_s.push_back(1e-3 * i);
    result.hip_mm.push_back(end + out * (kApproachMm * (1.0 - static_cast<double>(i) / kApproachFrames)));
  }
  for (std::size_t i = 0; i < path.size(); ++i) {
    result.t_s.push_back(path.t_s[i] - path.t_s[0] + 1e-3 * kApproachFrames);
    result.hip_mm.push_back(path.hip_mm[i]);
  }
  return result;
}

[[nodiscard]] Status prepare(const std::string& points, Ground& ground) {
  PALPATE_ASSIGN(
      experiments::GeneratedScene made,
      experiments::generated_scene("sinusoid:points=" + points,
                                   "weave:frames=50000:rate_hz=1000:speed_mm_s=50:depth_mm=2:seed=1"));
  ground.scene = std::move(made.input);
  const render::ModelInput& model = ground.scene.models.front();
  ground.path = approached(made.path, *model.analytic);
  PALPATE_ASSIGN(ground.mesh, baselines::SurfaceMesh::build(*model.original_mesh, 0));
  ground.tree = std::make_unique<baselines::FacetTree>(ground.mesh);
  for (const Vec3& hip : ground.path.hip_mm)
    ground.closest.push_back(ground.tree->closest(hip - ground.mesh.origin_mm()).point.point);
  return Done{};
}

struct Track {
  double rms_mm = 0.0, max_mm = 0.0;
};

/// Errors over contact frames. A sphere's centre is a radius off the surface, so its skin is compared.
Track track(const Ground& ground, const trace::ForceTrace& trace, double centre_radius) {
  double sum = 0.0, most = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    if (!trace.frames[i].contact) continue;
    const Vec3& hip = ground.path.hip_mm[i];
    Vec3 god = trace.frames[i].god_object_mm;
    const double pulled = (hip - god).norm();
    if (centre_radius > 0.0 && pulled <= centre_radius) continue;
    if (centre_radius > 0.0) god += (hip - god) * (centre_radius / pulled);
    const double off = (god - ground.mesh.origin_mm() - ground.closest[i]).norm();
    sum += off * off;
    most = std::max(most, off);
    ++count;
  }
  return {count > 0 ? std::sqrt(sum / static_cast<double>(count)) : 0.0, most};
}

struct Jams {
  int jammed = 0, restless = 0, most_calls = 0;
  double most_off_rad = 0.0, most_off_mm = 0.0;
};

/// A renderer's mesh, possibly refined.
struct Own {
  baselines::SurfaceMesh mesh;
  std::unique_ptr<baselines::FacetTree> tree;
};

/// Reruns the path and stops at frames evenly spread over the contact frames of `trace`.
Jams jams(const Ground& ground, const Own& own, render::HapticRenderer& renderer,
          const trace::ForceTrace& trace, int stops, double centre_radius) {
  std::vector<std::size_t> touched;
  for (std::size_t i = 0; i < trace.frames.size(); ++i)
    if (trace.frames[i].contact) touched.push_back(i);
  Jams result;
  renderer.restart(ground.path.hip_mm.front(), 0.0);
  std::size_t done = 0;
  double t_s = 0.0;
  const auto step = [&](const Vec3& hip) { return renderer.step(hip, t_s += kStepS); };
  for (int stop = 0; stop < stops; ++stop) {
    const std::size_t at =
        touched[touched.size() * static_cast<std::size_t>(stop) / static_cast<std::size_t>(stops)];
    const Vec3& hip = ground.path.hip_mm[at];
    render::Frame frame;
    for (; done <= at; ++done) frame = step(ground.path.hip_mm[done]);
    int calls = 0, same = 0;
    for (; calls < kMostCalls && same < kRestCalls; ++calls) {
      const render::Frame next = step(hip);
      same =
          next.god_object_mm == frame.god_object_mm && next.status == render::FrameStatus::kOk ? same + 1 : 0;
      frame = next;
    }
    result.most_calls = std::max(result.most_calls, calls - same);
    result.restless += same < kRestCalls;
    const Vec3& own_origin = own.mesh.origin_mm();
    const baselines::Rest rest = baselines::rest_of(own.mesh, *own.tree, frame.god_object_mm - own_origin,
                                                    centre_radius, kReachMm, hip - own_origin);
    result.jammed += same < kRestCalls || !(rest.off_rad <= kMostOffRad);
    result.most_off_rad = std::max(result.most_off_rad, rest.off_rad);
    const Vec3 towards = (hip - frame.god_object_mm).normalized() * centre_radius;
    result.most_off_mm =
        std::max(result.most_off_mm,
                 (frame.god_object_mm + towards - ground.mesh.origin_mm() - ground.closest[at]).norm());
  }
  return result;
}

[[nodiscard]] Status run(const Ground& ground, const std::string& spec, int stops) {
  render::Registry registry;
  render::register_toolkit_renderers(registry);
  baselines::register_baseline_renderers(registry);
  PALPATE_ASSIGN(const NamedOptions named, parse_named_options(spec));
  PALPATE_ASSIGN(const std::unique_ptr<render::HapticRenderer> renderer,
                 registry.make(named.name, named.options));
  PALPATE_ASSIGN(const render::PrepareReport report, renderer->prepare(ground.scene, {}));
  PALPATE_ASSIGN(const trace::ReplayReport measured, trace::measure(*renderer, ground.path, {}));
  const Options options = renderer->describe().options;
  const bool centred = named.name == "mesh-proxy" && options.text("tip") == "centre";
  const double radius = centred ? options.number("radius_mm") : 0.0;
  if (centred && !(radius > 0.0)) return Error{"a sphere's rest is judged by its radius", "give radius_mm"};
  const Track tracked = track(ground, measured.trace, radius);
  const auto* holder = dynamic_cast<const baselines::MeshHolder*>(renderer.get());
  if (holder == nullptr) return Error{"this renderer works on no mesh", "take a mesh renderer"};
  PALPATE_ASSIGN(baselines::SurfaceMesh mesh, baselines::SurfaceMesh::build(*holder->mesh(0), 0));
  Own own{std::move(mesh), nullptr};
  own.tree = std::make_unique<baselines::FacetTree>(own.mesh);
  const Jams found = jams(ground, own, *renderer, measured.trace, stops, radius);
  fmt::print(
      "{:60} {:7.0f} {:9.2e} {:9.2e} {:6.2f} {:6.2f} {:6.2f} {:7.1f} {:5} {:6} {:6} {:9.1e} {:9.2e}\n", spec,
      report.total_ms, tracked.rms_mm, tracked.max_mm,
      static_cast<double>(measured.counters.walk_steps) / static_cast<double>(measured.counters.frames),
      measured.contact->mean_us.value_or(0.0), measured.contact->p50_us.value_or(0.0),
      measured.contact->p999_us.value_or(0.0), measured.counters.bound_hits, found.jammed, found.most_calls,
      found.most_off_rad, found.most_off_mm);
  std::fflush(stdout);
  return Done{};
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) {
  using namespace palpate;
  const std::string points = argc > 1 ? argv[1] : "1002001";
  const int stops = argc > 2 ? std::atoi(argv[2]) : 100;
  std::vector<std::string> specs(argv + std::min(argc, 3), argv + argc);
  if (specs.empty())
    specs = {"mesh-godobject:mesh=original", "mesh-proxy:mesh=original:tip=centre:radius_mm=0.1",
             "mesh-proxy:mesh=original:tip=centre:radius_mm=0.5",
             "mesh-proxy:mesh=original:tip=centre:radius_mm=1"};
  Ground ground;
  Status done = stops > 0 ? prepare(points, ground) : Status(Error{"no stops", "give a positive number"});
  if (done.ok()) {
    fmt::print("{} triangles, {} frames, {} stops; times in ms (prepare) and us\n",
               ground.mesh.facets().size(), ground.path.size(), stops);
    fmt::print("{:60} {:>7} {:>9} {:>9} {:>6} {:>6} {:>6} {:>7} {:>5} {:>6} {:>6} {:>9} {:>9}\n", "renderer",
               "prepare", "RMS mm", "max mm", "moves", "mean", "median", "p99.9", "bound", "jammed", "calls",
               "off rad", "off mm");
  }
  for (std::size_t i = 0; done.ok() && i < specs.size(); ++i) done = run(ground, specs[i], stops);
  if (done.ok()) return 0;
  fmt::print(stderr, "{}\n", done.error().message());
  return 1;
}
