// Findings of the hunt and the fuzzer, played by every renderer of ours in every build.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include <palpate/options.h>
#include <palpate/replay.h>
#include "tests/house/all_renderers.h"
#include "tests/house/corpus_scene.h"
#include "toolkit/core/random.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size);

namespace palpate::house {
namespace {

namespace fs = std::filesystem;

/// A resting god object may be off by its last step: cloud-smooth stops at a hundredth of a voxel, whose
/// square is the error of the squared distance.
constexpr double kRestShare = 1e-5;

std::vector<std::string> files_in(const std::string& folder, const std::string& ending) {
  std::vector<std::string> names;
  for (const fs::directory_entry& entry : fs::directory_iterator(folder))
    if (entry.path().extension() == ending) names.push_back(entry.path().stem().string());
  std::sort(names.begin(), names.end());
  return names;
}

void expect_promises(const trace::ProbePath& path, const trace::ForceTrace& trace) {
  Vec3 god = path.hip_mm[0];
  double stored = 0.0, made = 0.0;
  for (std::size_t k = 0; k < path.size(); ++k) {
    const render::Frame& frame = trace.frames[k];
    ASSERT_TRUE(is_finite(frame.force_n) && is_finite(frame.god_object_mm)) << "frame " << k;
    ASSERT_TRUE(frame.contact || frame.force_n == Vec3::Zero()) << "frame " << k;
    const double now = (path.hip_mm[k] - frame.god_object_mm).squaredNorm();
    stored = std::max(stored, now);
    if (frame.contact) made += std::max(0.0, now - (path.hip_mm[k] - god).squaredNorm());
    god = frame.contact ? frame.god_object_mm : path.hip_mm[k];
  }
  EXPECT_NE(trace.frames.back().status, render::FrameStatus::kBoundHit) << "after a rest";
  EXPECT_LE(made, kRestShare * stored) << "energy out of nothing";
}

TEST(Hunted, CasesKeepTheirPromisesNow) {
  render::Registry registry;
  register_all_renderers(registry);
  const std::string folder = corpus_folder() + "../hunt/";
  int played = 0;
  for (const std::string& name : files_in(folder, ".toml")) {
    const CorpusScene loaded = load_corpus("../hunt/" + name + ".toml", "../hunt/" + name + ".csv");
    for (const render::RendererInfo& info : registry.all()) {
      if (info.role != render::Role::kOurs) continue;
      SCOPED_TRACE(name + " by " + info.name);
      auto renderer = registry.make(info.name, {});
      ASSERT_TRUE(renderer.ok()) << renderer.error().message();
      if (!(*renderer)->prepare(loaded.scene.input, {1, nullptr})) continue;
      const auto first = trace::replay(**renderer, loaded.path),
                 again = trace::replay(**renderer, loaded.path);
      ASSERT_TRUE(first.ok() && again.ok());
      EXPECT_EQ(trace::trace_hash(*first), trace::trace_hash(*again)) << "a restart forgets everything";
      expect_promises(loaded.path, *first);
      ++played;
    }
  }
  EXPECT_GT(played, 0);
}

/// Renderers of ours on a cloud of these points.
const std::vector<std::string> kOnPoints = {"cloud", "cloud-smooth"};

std::unique_ptr<render::HapticRenderer> prepared(const std::string& text, const std::vector<Vec3>& points) {
  render::Registry registry;
  register_all_renderers(registry);
  const NamedOptions named = parse_named_options(text).value();
  auto renderer = registry.make(named.name, named.options).value();
  render::ModelInput model;
  model.cloud =
      std::make_shared<const cloud::Cloud>(cloud::build_cloud(points, cloud::NonFinite::kRefuse).value());
  render::SceneInput scene;
  scene.models.push_back(model);
  EXPECT_TRUE(renderer->prepare(scene, {1, nullptr}).ok()) << text;
  return renderer;
}

/// A straight motion in that many frames; returns the last frame.
render::Frame gone(render::HapticRenderer& renderer, const Vec3& from, const Vec3& to, double& t_s) {
  constexpr int kFrames = 50;
  render::Frame frame;
  for (int k = 1; k <= kFrames; ++k) {
    t_s += 1e-3;
    frame = renderer.step(from + (to - from) * (static_cast<double>(k) / kFrames), t_s);
  }
  return frame;
}

// Each closed piece has its own side: inside one ball is outside the other.
TEST(Hunted, StartsInsideOneOfTwoHollowBalls) {
  Random random(51);
  constexpr double kRadius = 10.0;
  const Vec3 one(-15, 0, 0), other(15, 0, 0);
  std::vector<Vec3> points;
  for (int i = 0; i < 8000; ++i) {
    const Vec3 d{random.normal(), random.normal(), random.normal()};
    points.push_back((i % 2 == 0 ? one : other) + kRadius * d.normalized());
  }
  for (const std::string& text : kOnPoints) {
    SCOPED_TRACE(text);
    const auto renderer = prepared(text, points);
    double t_s = 0.0;
    renderer->restart(one, t_s);
    // Through the wall from inside: held, and pushed back in.
    const render::Frame inside = gone(*renderer, one, one + Vec3(0, 0, kRadius + 1.0), t_s);
    EXPECT_TRUE(inside.contact);
    EXPECT_LT(inside.force_n.z(), 0.0);
    EXPECT_FALSE(gone(*renderer, one + Vec3(0, 0, kRadius + 1.0), one, t_s).contact);
    // Releases above the other ball, in free space, like a lifted hand.
    const Vec3 above = other + Vec3(0, 0, 2.0 * kRadius);
    renderer->release_contact(above);
    const render::Frame outside = gone(*renderer, above, other + Vec3(0, 0, kRadius - 1.0), t_s);
    EXPECT_TRUE(outside.contact);
    EXPECT_GT(outside.force_n.z(), 0.0);
  }
}

// The apex has more facets than a star has corners, of points sixty times as dense along the rings as across.
// Boxes hold everywhere. Triangles are missing near the apex, and fits of such uneven points are off there:
// these let the HIP in at some places, but release what they hold.
TEST(Hunted, AnApexOfManyFacetsLetsGo) {
  constexpr int kAround = 400;
  constexpr double kStepMm = 0.5;
  std::vector<Vec3> points = {Vec3::Zero()};
  for (int ring = 1; ring <= 20; ++ring)
    for (int k = 0; k < kAround; ++k) {
      const double angle = 2.0 * std::numbers::pi * (k + 0.5 * (ring % 2)) / kAround, r = kStepMm * ring;
      points.emplace_back(r * std::cos(angle), r * std::sin(angle), -r);
    }
  Random random(52);
  for (const std::string& text : kOnPoints) {
    SCOPED_TRACE(text);
    const auto renderer = prepared(text, points);
    int held = 0, released = 0;
    constexpr int kTried = 60;
    double t_s = 0.0;
    for (int i = 0; i < kTried; ++i) {
      const double angle = random.uniform(0.0, 2.0 * std::numbers::pi), r = random.uniform(0.0, 6.0);
      const Vec3 on(r * std::cos(angle), r * std::sin(angle), -r);
      const Vec3 above = on + Vec3(0, 0, 2), below = on - Vec3(0, 0, 1);
      renderer->restart(above, t_s);
      held += gone(*renderer, above, below, t_s).contact;
      released += !gone(*renderer, below, above, t_s).contact;
    }
    EXPECT_GT(held, kTried / 2);
    EXPECT_EQ(released, kTried);
  }
}

TEST(Hunted, BytesOfTheFuzzerEndWell) {
  const std::string folder = corpus_folder() + "../frame/";
  int played = 0;
  for (const std::string& name : files_in(folder, ".bin")) {
    SCOPED_TRACE(name);
    std::ifstream file(folder + name + ".bin", std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(file), {}};
    EXPECT_EQ(LLVMFuzzerTestOneInput(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()), 0);
    ++played;
  }
  EXPECT_GT(played, 0);
}

}  // namespace
}  // namespace palpate::house
