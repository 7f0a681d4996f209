// `cloud` driven by each partition, and by the swept sphere: what finds the boxes must not be felt.
#include <gtest/gtest.h>

#include <memory>
#include <string>
#include <vector>

#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/points/point_model.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"
#include "toolkit/trace/paths.h"
#include "toolkit/trace/replay.h"

namespace palpate::render {
namespace {

struct Ran {
  std::string hash;
  FrameCounters counters;
  std::size_t contacts = 0;
  PrepareReport report;
};

struct Setting {
  SceneInput scene;
  trace::ProbePath path;
};

Setting setting(const std::string& model_spec, const std::string& path_spec) {
  auto model = cloud::generate(parse_named_options(model_spec).value()).value();
  Setting made;
  ModelInput input;
  input.cloud = std::make_shared<cloud::Cloud>(std::move(model.cloud));
  made.scene.models.push_back(input);
  trace::PathTarget target;
  target.surface = model.surface.get();
  target.cloud = input.cloud.get();
  target.box_mm = input.cloud->box_mm();
  target.spacing_mm = model.nominal_spacing_mm;
  made.path = trace::make_path(parse_named_options(path_spec).value(), target).value();
  return made;
}

Ran run(const Setting& setting, const std::string& spec) {
  Registry registry;
  register_toolkit_renderers(registry);
  const NamedOptions named = parse_named_options(spec).value();
  auto renderer = registry.make(named.name, named.options).value();
  Ran ran;
  ran.report = renderer->prepare(setting.scene, {1, nullptr}).value();
  const trace::ForceTrace trace = trace::replay(*renderer, setting.path).value();
  ran.hash = trace::trace_hash(trace);
  ran.counters = renderer->counters();
  for (const Frame& frame : trace.frames) ran.contacts += frame.contact;
  return ran;
}

TEST(AnyPartition, DrivesCloudToTheSameTrace) {
  const std::vector<std::pair<std::string, std::string>> settings = {
      {"sinusoid:points=10000", "weave:frames=4000"},
      {"sinusoid:points=10000:jitter=0.4:nonuniform=0.5", "exploration:frames=6000"},
      {"sphere:points=8000", "weave:frames=4000"},
      {"slab:points=8000", "exploration:frames=6000"},
      {"wedge:points=4000:scale=1e-3", "weave:frames=4000:depth_mm=2e-3:clearance_mm=4e-4:speed_mm_s=0.05"},
      {"torus:points=8000:scale=1e6", "weave:frames=4000:depth_mm=2e6:clearance_mm=4e5:speed_mm_s=5e7"},
  };
  for (const auto& [model, path] : settings) {
    const Setting made = setting(model, path);
    for (const std::string box : {"global", "per-vertex"}) {
      const Ran grid = run(made, "cloud:surface=vertices:box=" + box);
      EXPECT_GT(grid.contacts, 0u) << model;
      EXPECT_LT(grid.contacts, made.path.size()) << model;
      for (const std::string other : {"octree", "quadtree"}) {
        const Ran tree = run(made, "cloud:surface=vertices:box=" + box + ":partition=" + other);
        EXPECT_EQ(tree.hash, grid.hash) << model << " " << path << " " << other << " " << box;
        EXPECT_EQ(tree.contacts, grid.contacts) << model;
        // Ten points a leaf instead of some twenty-five a cell: far fewer boxes are looked at.
        EXPECT_LT(tree.counters.box_tests, grid.counters.box_tests) << model << " " << other;
        // The points and their neighbours are the same; what a tree adds is its own.
        EXPECT_GT(tree.report.bytes, made.scene.models[0].cloud->size() *
                                         (sizeof(StoredPoint) + sizeof(neighbourhood::Neighbours)));
      }
    }
  }
}

// Points that move, points that are inferred and a stroke that is taken back: the partition follows.
TEST(AnyPartition, DrivesDentsToTheSameTrace) {
  for (const std::string model :
       {"sinusoid:points=10000", "sphere:points=8000", "plane:points=10000:jitter=0.3"}) {
    Setting made = setting(model, "weave:frames=6000:depth_mm=3");
    made.scene.models[0].surface.dent = {0.3, 3.0, 40.0};
    const Ran grid = run(made, "cloud:surface=vertices"),
              rigid = run(setting(model, "weave:frames=6000:depth_mm=3"), "cloud:surface=vertices");
    EXPECT_NE(grid.hash, rigid.hash) << model << " gives way";
    for (const std::string other : {"octree", "quadtree"}) {
      const Ran tree = run(made, "cloud:partition=" + other);
      EXPECT_EQ(tree.hash, grid.hash) << model << " " << other;
      // It is another partition: ten points a leaf and not some twenty-five a cell.
      EXPECT_LT(tree.counters.box_tests, grid.counters.box_tests) << model << " " << other;
    }
  }
}

// The side of a contact is judged by planes, so finding a sheet earlier changes nothing but the work.
TEST(SweptSphere, FindsMoreBoxesAndChangesNoFrameOfCloud) {
  const Setting made = setting("sinusoid:points=10000", "weave:frames=4000");
  const Ran box = run(made, "cloud:surface=vertices");
  EXPECT_EQ(box.counters.sphere_only, 0u);
  std::uint64_t last = 0;
  for (const std::string sphere : {"0.05", "0", "2"}) {
    const Ran swept = run(made, "cloud:test=swept-sphere:sphere_mm=" + sphere);
    EXPECT_EQ(swept.hash, box.hash) << sphere;
    EXPECT_GT(swept.counters.sphere_only, last) << sphere;
    EXPECT_GE(swept.counters.box_tests, box.counters.box_tests) << sphere;
    last = swept.counters.sphere_only;
  }
  const Ran tree = run(made, "cloud:test=swept-sphere:partition=octree");
  EXPECT_EQ(tree.hash, box.hash);
  EXPECT_GT(tree.counters.sphere_only, 0u);
}

// What the literal form gains: boxes that its cells hide from it. What it pays: it touches a radius earlier.
TEST(SweptSphere, TouchesEarlierInTheLiteralForm) {
  const Setting made = setting("sinusoid:points=10000", "weave:frames=4000:clearance_mm=4");
  const Ran box = run(made, "cloud-literal");
  const Ran swept = run(made, "cloud-literal:test=swept-sphere:sphere_mm=0.3");
  EXPECT_GT(swept.counters.sphere_only, 0u);
  EXPECT_GT(swept.contacts, box.contacts);
}

TEST(Cells, OfUnevenCloudsHoldFewPointsAndChangeNoFrame) {
  // One sparse place decides the resolution of a whole cloud.
  Scene scene = generated("sinusoid:points=10000:extent_mm=40:amplitude_mm=2:wavelength_mm=40");
  const cloud::Cloud& even = *scene.input.models[0].cloud;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < even.size(); ++i) {
    const Vec3 p = even.point_mm(i);
    if (p.x() < 14.0 || p.y() < 14.0 || i % 16 == 0) points.push_back(p);
  }
  const SceneInput uneven = cloud_of(points);
  trace::PathTarget target;
  target.cloud = uneven.models[0].cloud.get();
  target.box_mm = target.cloud->box_mm();
  const trace::ProbePath path =
      trace::make_path(parse_named_options("exploration:frames=20000:seed=2").value(), target).value();
  std::vector<FrameCounters> counters;
  std::vector<std::vector<Frame>> frames;
  for (const char* spec : {"cloud:cell=5", "cloud:surface=vertices"}) {
    const auto renderer = prepared(uneven, spec);
    renderer->restart(path.hip_mm[0]);
    std::vector<Frame>& own = frames.emplace_back();
    for (const Vec3& h : path.hip_mm) own.push_back(renderer->step(h, 1e-3));
    counters.push_back(renderer->counters());
  }
  for (std::size_t i = 0; i < frames[0].size(); ++i)
    ASSERT_EQ(frames[0][i].force_n, frames[1][i].force_n) << i;
  EXPECT_EQ(counters[0].bound_hits, 0u);
  EXPECT_EQ(counters[1].bound_hits, 0u);
  EXPECT_LT(3 * counters[1].box_tests, counters[0].box_tests);
}

}  // namespace
}  // namespace palpate::render
