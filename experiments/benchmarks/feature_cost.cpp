// Cost of each scene feature per frame and in memory, for our renderers. Compares the bare scene, the scene
// with one feature, and a scene that explicitly declines it. A declining scene must match the bare one to the
// instruction and byte.
//
//   feature_cost [RENDERER ..]             lines "RENDERER FEATURE KIND INSTRUCTIONS REPORTED HEAP"
//   feature_cost --marked RENDERER         the frames alone, between marks, for valgrind
#include <fmt/format.h>

#include <algorithm>
#include <atomic>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <functional>
#include <new>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/control.h>
#include <palpate/registry.h>
#include "experiments/benchmarks/generated_scene.h"
#include "toolkit/core/instruction_counter.h"

namespace {

/// Bytes requested from operator new and not freed. The allocator's own count rounds and includes its
/// reserve.
std::atomic<std::uint64_t> live_bytes{0};
/// Header before each block that stores its size; keeps alignments up to this.
constexpr std::size_t kBefore = 64;

void* allocate(std::size_t bytes, std::size_t alignment) {
  const std::size_t before = std::max(kBefore, alignment);
  const std::size_t whole = (bytes + before + before - 1) / before * before;
  auto* const block = static_cast<unsigned char*>(std::aligned_alloc(before, whole));
  if (block == nullptr) throw std::bad_alloc();
  const std::size_t note[2] = {bytes, before};
  std::memcpy(block + before - sizeof(note), note, sizeof(note));
  live_bytes += bytes;
  return block + before;
}
void release(void* p) noexcept {
  if (p == nullptr) return;
  std::size_t note[2];
  auto* const at = static_cast<unsigned char*>(p);
  std::memcpy(note, at - sizeof(note), sizeof(note));
  live_bytes -= note[0];
  std::free(at - note[1]);
}

}  // namespace

void* operator new(std::size_t bytes) {
  return allocate(bytes, kBefore);
}
void* operator new(std::size_t bytes, std::align_val_t alignment) {
  return allocate(bytes, static_cast<std::size_t>(alignment));
}
void operator delete(void* p) noexcept {
  release(p);
}
void operator delete(void* p, std::size_t) noexcept {
  release(p);
}
void operator delete(void* p, std::align_val_t) noexcept {
  release(p);
}
void operator delete(void* p, std::size_t, std::align_val_t) noexcept {
  release(p);
}

namespace palpate {
namespace {

constexpr const char* kScene = "sinusoid:points=961";
constexpr const char* kPath = "weave:frames=600";
constexpr int kModels = 20;
constexpr double kApartMm = 300.0;
constexpr double kLimitS = 300.0;

struct Asked {
  render::SceneInput scene;
  control::ControlOptions control;
};

enum class Kind { kBare, kOn, kOff };
struct Feature {
  const char* name;
  Kind kind;
  std::function<void(Asked&)> ask;
  render::Features needs{};  ///< renderers without these skip the feature
};

std::shared_ptr<surface::PointProperties> properties() {
  return std::make_shared<surface::PointProperties>();
}
surface::Surface& surface_of(Asked& asked) {
  return asked.scene.models.front().surface;
}

/// A value per point, changing at x = 0.
std::vector<float> halves(const Asked& asked, float left, float right) {
  std::vector<float> values;
  for (const float x : asked.scene.models.front().cloud->x_mm) values.push_back(x > 0.0f ? right : left);
  return values;
}

void move_slowly(Asked& asked) {
  constexpr double kSpeedMmS = 0.5;
  auto simulation = std::make_shared<render::ScriptedSimulation>();
  render::ScriptedMotion motion;
  motion.velocity_mm_s = Vec3(kSpeedMmS, 0.0, 0.0);
  asked.scene.models.front().motion = simulation->add(motion);
  asked.scene.simulation = simulation;
}

void add_models(Asked& asked) {
  const render::ModelInput model = asked.scene.models.front();
  for (int i = 1; i < kModels; ++i) {
    asked.scene.models.push_back(model);
    asked.scene.models.back().world_from_model.translation_mm.x() = kApartMm * i;
  }
}

void add_asking(std::vector<Feature>& all) {
  using enum render::Feature;
  const auto on = [&](const char* name, std::function<void(Asked&)> ask, render::Features needs = {}) {
    all.push_back({name, Kind::kOn, std::move(ask), needs});
  };
  on(
      "friction",
      [](Asked& a) {
        surface_of(a).friction = {0.7, 0.5};
      },
      kFriction);
  on(
      "texture",
      [](Asked& a) {
        surface::Texture& texture = surface_of(a).texture;
        texture.kind = surface::TextureKind::kNoise;
        texture.depth_mm = 0.1;
        texture.wavelength_mm = 2.0;
      },
      kTexture);
  on(
      "stiffness-by-point",
      [](Asked& a) {
        auto p = properties();
        p->stiffness_n_per_mm = halves(a, 0.2f, 0.5f);
        surface_of(a).per_point = p;
      },
      kPerPoint);
  on(
      "deformation-by-point",
      [](Asked& a) {
        auto p = properties();
        p->deformation = halves(a, 0.0f, 0.5f);
        surface_of(a).per_point = p;
      },
      kPerPoint);
  on(
      "friction-by-point",
      [](Asked& a) {
        auto p = properties();
        p->static_friction = halves(a, 0.2f, 0.7f);
        surface_of(a).per_point = p;
      },
      kPerPoint | kFriction);
  on(
      "dents",
      [](Asked& a) {
        surface_of(a).dent = {0.5, 1.0, 5.0};
      },
      kDent);
  on(
      "moved-points", [](Asked& a) { a.scene.models.front().moves = std::make_shared<render::MoveQueue>(); },
      kMovedPoints);
  on("motion", move_slowly, kMotion);
  on("many-models", add_models, render::Feature::kManyModels);
  on("force-limit", [](Asked& a) { a.scene.force_limit_n = 0.5; });
  on("coupling", [](Asked& a) { a.control.coupling = control::Coupling{1.0, 0.0}; });
  on("filter", [](Asked& a) { a.control.filter.rate_limit_n_per_s = 100.0; });
  on("passivity", [](Asked& a) { a.control.passivity = control::PassivityOptions{}; });
}

/// The same features, declared absent or uniform.
void add_declining(std::vector<Feature>& all) {
  const auto off = [&](const char* name, std::function<void(Asked&)> ask) {
    all.push_back({name, Kind::kOff, std::move(ask)});
  };
  off("friction", [](Asked& a) { surface_of(a).friction = {0.0, 0.0}; });
  off("texture", [](Asked& a) {
    surface_of(a).texture.depth_mm = 0.1;  // of no kind
    surface_of(a).texture.wavelength_mm = 2.0;
  });
  off("deformation", [](Asked& a) { surface_of(a).deformation = 0.5; });  // uniform: a softer spring
  off("stiffness", [](Asked& a) { surface_of(a).stiffness_n_per_mm = 0.3; });
  off("by-point", [](Asked& a) { surface_of(a).per_point = properties(); });  // no column
  off("dents", [](Asked& a) { surface_of(a).dent = {0.5, 1.0, 0.0}; });       // with an infinite duration
  off("motion", [](Asked& a) { a.scene.simulation = std::make_shared<render::ScriptedSimulation>(); });
  off("force-limit", [](Asked& a) { a.scene.force_limit_n = 0.0; });
  off("control", [](Asked& a) {
    a.control.coupling.reset();
    a.control.filter = {};
    a.control.passivity.reset();
  });
  off("truth", [](Asked& a) { a.scene.models.front().analytic = nullptr; });  // used for scores only
}

std::vector<Feature> all_features() {
  std::vector<Feature> all = {{"bare", Kind::kBare, [](Asked&) {}}};
  add_asking(all);
  add_declining(all);
  return all;
}

std::string part_name(const Feature& feature) {
  return (feature.kind == Kind::kOff ? "no-" : "") + std::string(feature.name);
}

struct Stand {
  render::SceneInput bare;
  trace::ProbePath path;
  render::Registry registry;
};

Result<Stand> make_stand() {
  Stand stand;
  render::register_toolkit_renderers(stand.registry);
  PALPATE_ASSIGN(experiments::GeneratedScene made, experiments::generated_scene(kScene, kPath));
  made.input.models.front().original_mesh = nullptr;
  stand.path = std::move(made.path);
  stand.bare = std::move(made.input);
  return stand;
}

struct Prepared {
  Asked asked;
  std::unique_ptr<render::HapticRenderer> renderer;
  std::uint64_t reported = 0;  ///< bytes, by the renderer
  std::uint64_t heap = 0;      ///< bytes, by the allocator
};

Result<Prepared> prepare(const Stand& stand, const std::string& name, const Feature& feature) {
  Prepared made;
  made.asked.scene = stand.bare;
  feature.ask(made.asked);
  const std::uint64_t before = live_bytes.load();
  const NamedOptions named = parse_named_options(name).value();
  auto renderer = stand.registry.make(named.name, named.options);
  if (!renderer) return renderer.error();
  made.renderer = control::wrap(*std::move(renderer), made.asked.control);
  {
    const Result<render::PrepareReport> report = made.renderer->prepare(made.asked.scene, {1, nullptr});
    if (!report) return report.error();
    made.reported = report->bytes;
  }
  made.heap = live_bytes.load() - before;
  return made;
}

/// Sum of forces: prevents optimising frames away and reveals a scene without contact.
[[gnu::noinline]] Vec3 step_all(render::HapticRenderer& renderer, const trace::ProbePath& path,
                                render::Simulation* simulation) {
  Vec3 sum = Vec3::Zero();
  for (std::size_t k = 0; k < path.size(); ++k) {
    if (simulation != nullptr) simulation->advance(path.t_s[k]);
    sum += renderer.step(path.hip_mm[k], path.t_s[k]).force_n;
  }
  return sum;
}

void restart(const Stand& stand, Prepared& made) {
  if (made.asked.scene.simulation != nullptr) made.asked.scene.simulation->reset();
  made.renderer->restart(stand.path.hip_mm[0], -stand.path.t_s[1]);
}

/// The simulation of a scene with moving models; null for others, since its cost is no renderer's.
render::Simulation* simulation_of(const Prepared& made) {
  return made.asked.scene.models.front().motion != nullptr ? made.asked.scene.simulation.get() : nullptr;
}

int run_marked(const Stand& stand, const std::string& renderer) {
  for (const Feature& feature : all_features()) {
    Result<Prepared> made = prepare(stand, renderer, feature);
    if (!made) continue;
    restart(stand, *made);
    (void)step_all(*made->renderer, stand.path, simulation_of(*made));  // warm-up
    restart(stand, *made);
    const std::string part = part_name(feature);
    begin_counting();
    const Vec3 sum = step_all(*made->renderer, stand.path, simulation_of(*made));
    end_counting(part.c_str());
    if (!(sum.norm() > 0.0)) return 1;
  }
  return 0;
}

const char* word(Kind kind, bool supported) {
  if (!supported) return "lacks";
  return kind == Kind::kBare ? "bare" : kind == Kind::kOn ? "on" : "off";
}

int show(const Stand& stand, const std::string& self, const std::string& renderer) {
  const auto counted = count_instructions({self, "--marked", renderer}, {.time_limit_s = kLimitS});
  if (!counted) {
    fmt::print(stderr, "feature_cost: error: {}\n", counted.error().message());
    return 1;
  }
  const render::RendererInfo& info = *stand.registry.find(parse_named_options(renderer).value().name);
  // Warm-up for what libraries allocate once.
  (void)prepare(stand, renderer, all_features().front());
  for (const Feature& feature : all_features()) {
    Result<Prepared> made = prepare(stand, renderer, feature);
    const auto part = counted->find(part_name(feature));
    if (!made || part == counted->end()) continue;
    const char* kind = word(feature.kind, feature.needs.without(info.supports).empty());
    fmt::print("{} {} {} {} {} {}\n", renderer, feature.name, kind, part->second, made->reported, made->heap);
  }
  return 0;
}

std::vector<std::string> our_renderers(const render::Registry& registry) {
  std::vector<std::string> names = {"cloud:refine=1"};
  for (const render::RendererInfo& info : registry.all())
    if ((info.role == render::Role::kOurs && info.geometry != render::Geometry::kImages) ||
        info.role == render::Role::kLiteral)
      names.push_back(info.name);
  return names;
}

int run(std::span<char*> words) {
  std::vector<std::string> named(words.begin() + 1, words.end());
  Result<Stand> stand = make_stand();
  if (!stand) return 1;
  const bool marked = named.size() == 2 && named.front() == "--marked";
  if (marked) named.erase(named.begin());
  for (const std::string& name : named) {
    const Result<NamedOptions> options = parse_named_options(name);
    if (options && stand->registry.make(options->name, options->options)) continue;
    fmt::print(stderr, "feature_cost: error: {} is no renderer of the toolkit\n", name);
    return 2;
  }
  if (marked) return run_marked(*stand, named.front());
  for (const std::string& name : named.empty() ? our_renderers(stand->registry) : named)
    if (const int status = show(*stand, words.front(), name); status != 0) return status;
  return 0;
}

}  // namespace
}  // namespace palpate

int main(int argc, char** argv) {
  return palpate::run({argv, static_cast<std::size_t>(argc)});
}
