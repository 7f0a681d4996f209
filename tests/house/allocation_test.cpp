// No frame allocates: 10,000 frames of every registered renderer, entering and leaving the model.
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <vector>

#include <palpate/control.h>
#include <palpate/device/servo_loop.h>
#include <palpate/generate.h>
#include <palpate/options.h>
#include <palpate/triple_buffer.h>
#include "device/simulated/simulated_arm.h"
#include "tests/device/rig.h"
#include "tests/house/allocation_count.h"
#include "tests/house/corpus_scene.h"
#include "tests/house/example_renderer.h"
#include "tests/stepped.h"
#include "toolkit/core/random.h"
#include "toolkit/deformation/deformer.h"
#include "toolkit/geometry/broad_phase.h"

namespace palpate::house {
namespace {

constexpr std::size_t kFrames = 10'000;

TEST(AllocationCount, SeesEveryKind) {
  struct alignas(64) Wide {
    double values[8];
  };
  const auto blocks = [](auto&& work) {
    const AllocationCount count;
    work();
    return count.count();
  };
  // volatile prevents the compiler from removing a pair of new and delete.
  EXPECT_EQ(blocks([] {}), 0u);
  EXPECT_GE(blocks([] {
              int* volatile p = new int(1);
              delete p;
            }),
            1u);
  EXPECT_GE(blocks([] {
              Wide* volatile p = new Wide();
              delete p;
            }),
            1u);
  EXPECT_GE(blocks([] {
              void* volatile p = std::malloc(16);
              std::free(p);
            }),
            1u);
  EXPECT_GE(blocks([] {
              void* volatile p = std::calloc(2, 16);
              std::free(p);
            }),
            1u);
  EXPECT_GE(blocks([] {
              Eigen::VectorXd v = Eigen::VectorXd::Zero(100);
              ASSERT_EQ(v.size(), 100);
            }),
            1u);
}

// The surface point wanders over the model; the HIP goes 1 mm in and out along its normal.
std::vector<Vec3> weaving_path(const geometry::AnalyticSurface& surface) {
  constexpr double kPi = 3.14159265358979323846;
  constexpr double kPeriodFrames = 500.0;  // ten entries and ten exits in 5,000 frames
  std::vector<Vec3> path;
  path.reserve(kFrames);
  for (std::size_t i = 0; i < kFrames; ++i) {
    const double k = static_cast<double>(i);
    const auto at = surface.at(0.5 + 0.3 * std::sin(0.001 * k), 0.5 + 0.3 * std::sin(0.0016 * k));
    path.push_back(at.point_mm + std::cos(2.0 * kPi * k / kPeriodFrames) * at.normal);
  }
  return path;
}

struct Stand {
  render::SceneInput scene;
  std::vector<Vec3> path;
  render::Registry registry;
};

Stand sinusoid_stand() {
  auto generated = cloud::generate(parse_named_options("sinusoid:points=40401:seed=1").value()).value();
  Stand stand;
  stand.scene.force_limit_n = 3.3;
  stand.scene.models.resize(1);
  render::ModelInput& model = stand.scene.models[0];
  model.name = "sinusoid";
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(generated.cloud));
  model.original_mesh = generated.original_mesh;
  model.analytic = generated.surface;
  stand.path = weaving_path(*model.analytic);
  stand.registry = all_renderers();
  example::register_ball(stand.registry);
  return stand;
}

/// Blocks allocated by the path's frames; checks that it was felt and, except for the ball, left.
std::uint64_t blocks_of_frames(test::Stepped renderer, const Stand& stand, bool leaves) {
  const auto prepared = renderer->prepare(stand.scene, {});
  EXPECT_TRUE(prepared.ok()) << prepared.error().message();
  std::size_t in_contact = 0;
  renderer->restart(stand.path.front());
  const AllocationCount count;
  for (const Vec3& hip_mm : stand.path) in_contact += renderer->step(hip_mm, 1e-3).contact;
  renderer->release_contact(stand.path.front());
  const std::uint64_t blocks = count.count();
  EXPECT_GT(in_contact, kFrames / 10) << "the path must be felt";
  EXPECT_TRUE(!leaves || in_contact < kFrames) << "and left";
  return blocks;
}

TEST(Frames, NoRendererAllocates) {
  const Stand stand = sinusoid_stand();
  ASSERT_GE(stand.registry.all().size(), 2u) << "no renderer is registered";
  for (const render::RendererInfo& info : stand.registry.all()) {
    if (info.geometry == render::Geometry::kImages) continue;  // counted with a camera, in depth_surface
    SCOPED_TRACE(info.name);
    auto renderer = stand.registry.make(info.name, {});
    ASSERT_TRUE(renderer.ok()) << renderer.error().message();
    EXPECT_EQ(blocks_of_frames(*std::move(renderer), stand, info.name != "ball"), 0u);
  }
}

TEST(Frames, NoSurfaceAllocates) {
  // All that a scene can have: friction, texture, varying stiffness, a dent, other models, motion.
  Stand stand = sinusoid_stand();
  auto simulation = std::make_shared<render::ScriptedSimulation>();
  render::ModelInput& model = stand.scene.models[0];
  auto properties = std::make_shared<surface::PointProperties>();
  for (std::size_t i = 0; i < model.cloud->size(); ++i)
    properties->deformation.push_back(i % 2 == 0 ? 0.5f : 0.0f);
  model.surface.per_point = properties;
  model.surface.friction = {0.7, 0.5};
  model.surface.texture.kind = surface::TextureKind::kNoise;
  model.surface.texture.depth_mm = 0.05;
  model.surface.texture.wavelength_mm = 1.0;
  for (int i = 1; i < 40; ++i) {
    stand.scene.models.push_back(stand.scene.models[0]);
    stand.scene.models.back().world_from_model.translation_mm.x() = 60.0 * (i % 7);
  }
  render::ScriptedMotion motion;
  motion.velocity_mm_s = Vec3(0, 0, 0.5);
  motion.angular_velocity_rad_s = Vec3(0, 0, 0.01);
  stand.scene.models[1].motion = simulation->add(motion);
  stand.scene.models[0].surface.dent = {0.5, 2.0, 5.0};
  stand.scene.simulation = simulation;
  for (const char* name : {"cloud", "cloud-vertices", "cloud-literal", "mesh-godobject:mesh=original",
                           "mesh-proxy:mesh=original"}) {
    SCOPED_TRACE(name);
    const NamedOptions named = parse_named_options(name).value();
    if (stand.registry.find(named.name) == nullptr) continue;  // built without the baselines
    test::Stepped renderer(stand.registry.make(named.name, named.options).value());
    renderer->drive(simulation);
    EXPECT_EQ(blocks_of_frames(std::move(renderer), stand, false), 0u);
  }
}

TEST(Frames, NoChangeOfShapeAllocates) {
  Stand stand = sinusoid_stand();
  render::ModelInput& model = stand.scene.models[0];
  model.surface.dent = {0.2, 2.0, 50.0};
  model.moves = std::make_shared<render::MoveQueue>();
  const test::Stepped renderer(stand.registry.make("cloud", {}).value());
  ASSERT_TRUE(renderer->prepare(stand.scene, {}));
  auto& editable = dynamic_cast<deformation::Editable&>(*renderer);
  renderer->restart(stand.path.front());
  Random random(5);
  int undone = 0;
  const AllocationCount count;
  for (std::size_t i = 0; i < stand.path.size(); ++i) {
    if (render::MoveBatch* batch = i % 10 == 0 ? model.moves->begin() : nullptr; batch != nullptr) {
      for (; batch->count < render::kMaxBatch; ++batch->count) {
        const auto point = static_cast<std::uint32_t>(random.below(model.cloud->size()));
        batch->point[batch->count] = point;
        batch->to_mm[batch->count] =
            (model.cloud->local_mm(point) + Vec3(0, 0, 0.1 * random.normal())).cast<float>();
      }
      model.moves->publish();
    }
    (void)renderer->step(stand.path[i], 1e-3);
    if (i % 1000 == 999) undone += editable.undo(0);
    if (i % 2500 == 2499) editable.restore(0);
  }
  EXPECT_EQ(count.count(), 0u);
  EXPECT_GT(undone, 1);
  EXPECT_GT(editable.deform_counters(0).inferred, 0u);
}

TEST(Frames, NoControlAllocates) {
  const Stand stand = sinusoid_stand();
  control::ControlOptions options;
  options.coupling = control::Coupling{0.5, 1e-4};
  options.filter = {100.0, 500.0, control::FilterForm::kLiteral};
  options.passivity = control::PassivityOptions{};
  EXPECT_EQ(blocks_of_frames(control::wrap(stand.registry.make("cloud", {}).value(), options), stand, true),
            0u);
}

TEST(Frames, NoBroadPhaseAllocates) {
  std::vector<geometry::Aabb> boxes(300);
  for (std::size_t i = 0; i < boxes.size(); ++i)
    boxes[i].add(Vec3(static_cast<double>(i % 7), static_cast<double>(i % 11), static_cast<double>(i % 13)));
  geometry::BroadPhase phase(boxes);
  TripleBuffer<std::array<geometry::BoxHit, 16>> found;
  std::uint32_t hits = 0;
  const AllocationCount count;
  for (std::size_t i = 0; i < kFrames / 100; ++i) {
    for (std::size_t b = 0; b < boxes.size(); ++b) {
      const Vec3 by = static_cast<double>(b % 5) * Vec3(0.1, 0.2, -0.1);
      boxes[b] = {boxes[b].low_mm + by, boxes[b].high_mm + by};
    }
    phase.update(boxes);
    hits = phase.query(geometry::Aabb{boxes[0].low_mm, boxes[0].low_mm}.grown(3.0), found.back()).hits;
    found.publish();
    ASSERT_TRUE(found.acquire());
  }
  EXPECT_EQ(count.count(), 0u);
  EXPECT_GT(phase.rebuilds(), 0u);
  EXPECT_GT(hits, 0u);
}

}  // namespace
}  // namespace palpate::house

// ---- No tick allocates, including counting, observing and rearming.
namespace palpate::device {
namespace {

struct Counting final : TickObserver {
  void took(const Tick& tick) noexcept override { touched += tick.frame.contact ? 1 : 0; }
  int touched = 0;
};

TEST(Frames, NoTickOfTheServoLoopAllocates) {
  constexpr std::int64_t kNs = 2'000'000'000;
  VirtualClock clock;
  SpringPlane plane(0.5);
  const HandScript script =
      HandScript::create("press", {0.0, 0.2, 0.6}, {Vec3{0, 0, 5}, Vec3{0, 0, 5}, Vec3{0, 0, -3}},
                         HandScript::Between::kStraight)
          .value();
  SimulatedArm arm(arm_models().front(), hand_models()[1], script, clock);
  GovernorOptions governed;
  governed.period_s = 0.00025;
  Servo servo(plane, governed, arm, clock, {});
  Counting counting;
  const std::array<TickObserver*, 1> observers = {&counting};
  auto loop = ServoLoop::create(servo, clock, 4000, observers).value();
  ASSERT_TRUE(servo.start());
  int asked = 0;
  const house::AllocationCount count;
  const std::uint64_t ticks = run_accelerated(*loop, clock, kNs, [&] {
    constexpr int kRearmEvery = 3000;
    if (++asked % kRearmEvery == 0) loop->request_rearm();
    return true;
  });
  const std::uint64_t blocks = count.count();
  servo.stop();
  EXPECT_EQ(blocks, 0u);
  EXPECT_EQ(ticks, 8001u);
  EXPECT_GT(counting.touched, 1000) << "nothing was felt";
  EXPECT_EQ(loop->histograms().statistics().ticks, ticks);
}

}  // namespace
}  // namespace palpate::device
