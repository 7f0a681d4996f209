// A renderer caught up from a free place answers in contact like one that never released.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <palpate/device/contact_catch_up.h>
#include <palpate/replay.h>
#include "tests/house/all_renderers.h"
#include "tests/house/corpus_scene.h"

namespace palpate::house {
namespace {

constexpr double kTickS = 1e-3;
/// Ticks until a caught-up renderer is at rest.
constexpr int kRestTicks = 50;

/// Renderers with memory: two ways to one place rightly end with two forces.
const std::map<std::string, std::string> kExceptions = {
    {"cloud-literal", "figure 42 sticks: what it answers depends on the boxes that the way crossed"},
    {"sphere-proxy", "let go nearer to the points than its radius, the ball begins among them"},
    {"mesh-proxy", "let go nearer to the surface than its radius, the sphere begins smaller"},
    {"stream-proxy", "the proxy stops within a step of its goal, and the way decides where"},
    {"variable-proxy", "as stream-proxy: it shares its walk"},
    {"penalty-grid", "the side is that of the nearest point, which between two parts of a model is either's"},
};

/// The deepest frame of a contact and the last free frame before it.
struct Touch {
  std::size_t free, deep;
};
std::vector<Touch> touches_of(const trace::ForceTrace& trace) {
  std::vector<Touch> touches;
  std::optional<std::size_t> free;
  for (std::size_t i = 0; i < trace.frames.size(); ++i) {
    if (!trace.frames[i].contact) {
      free = i;
    } else if (free) {
      if (touches.empty() || touches.back().free != *free) touches.push_back({*free, i});
      const auto depth = [&](std::size_t k) { return trace.frames[k].force_n.norm(); };
      if (depth(i) > depth(touches.back().deep)) touches.back().deep = i;
    }
  }
  return touches;
}

/// Force at rest at a HIP reached along the path, and after release and catch-up from the last free place.
struct Forces {
  Vec3 tracked, brought_up;
};
Forces forces_at(render::HapticRenderer& renderer, const trace::ProbePath& path, const Touch& touch) {
  double t_s = 0.0;
  renderer.restart(path.hip_mm[0], t_s);
  const auto step = [&](const Vec3& hip) { return renderer.step(hip, t_s += kTickS); };
  for (std::size_t i = 0; i <= touch.free; ++i) (void)step(path.hip_mm[i]);
  // Straight to the deep place, like a catch-up.
  render::ContactCatchUp catch_up;
  const Vec3 deep = path.hip_mm[touch.deep];
  const auto rest = [&] {
    render::Frame frame;
    for (int i = 0; i < kRestTicks; ++i) frame = step(deep);
    return frame.force_n;
  };
  Forces forces;
  const Vec3 way = deep - path.hip_mm[touch.free];
  const double steps = std::max(1.0, std::ceil(way.norm() / render::ContactCatchUpOptions{}.step_mm));
  for (int i = 1; i <= steps; ++i) (void)step(path.hip_mm[touch.free] + (i / steps) * way);
  forces.tracked = rest();
  catch_up.begin(renderer, path.hip_mm[touch.free], t_s);
  for (int tick = 0; catch_up.pending(); ++tick) {
    EXPECT_LT(tick, 1000) << "it never arrives";
    (void)catch_up.advance(renderer, deep, t_s += kTickS);
  }
  forces.brought_up = rest();
  return forces;
}

TEST(ContactCatchUp, ReachesTheForceOfARendererThatNeverLetGo) {
  render::Registry registry;
  register_all_renderers(registry);
  const std::pair<const char*, const char*> kStands[] = {
      {"ridge.toml", "ridge.csv"}, {"torus.toml", "torus.csv"}, {"formula.toml", "plate.csv"}};
  for (const auto& [scene_file, path_file] : kStands) {
    const CorpusScene corpus = load_corpus(scene_file, path_file);
    for (const render::RendererInfo& info : registry.all()) {
      if (kExceptions.contains(info.name)) continue;
      SCOPED_TRACE(info.name + " on " + scene_file);
      Options options;
      for (const OptionSpec& option : info.options)
        if (option.key == "mesh") options.set("mesh", "original");
      const auto renderer = registry.make(info.name, options).value();
      if (!renderer->prepare(corpus.scene.input, {})) continue;  // no height field, no formula
      const auto trace = trace::replay(*renderer, corpus.path).value();
      const std::vector<Touch> touches = touches_of(trace);
      if (std::string(scene_file) != "formula.toml") {
        ASSERT_GE(touches.size(), 3u) << "the path must touch";
      }
      for (const Touch& touch : touches) {
        const Forces forces = forces_at(*renderer, corpus.path, touch);
        // Both rest at one place; the difference is how far each god object has settled.
        EXPECT_LE((forces.brought_up - forces.tracked).norm(), 1e-6 * (1.0 + forces.tracked.norm()))
            << "touch from frame " << touch.free << " to " << touch.deep << ": " << forces.tracked.transpose()
            << " against " << forces.brought_up.transpose();
      }
    }
  }
}

}  // namespace
}  // namespace palpate::house
