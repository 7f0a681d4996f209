// No frame allocates: 10,000 frames of every registered renderer, entering and leaving the model.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <memory>
#include <new>
#include <string>
#include <vector>

#include "tests/house/all_renderers.h"
#include "tests/house/allocation_count.h"
#include "tests/house/example_renderer.h"
#include "toolkit/cloud/generate.h"
#include "toolkit/core/options.h"

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
  // volatile: or the compiler removes a pair of new and delete.
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

// The surface point wanders over the model; the HIP goes 1 mm deep and 1 mm out along the normal there, back
// and forth.
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

TEST(Frames, NoRendererAllocates) {
  const auto spec = parse_named_options("sinusoid:points=40401:seed=1");
  ASSERT_TRUE(spec.ok());
  auto generated = cloud::generate(*spec);
  ASSERT_TRUE(generated.ok()) << generated.error().message();

  render::SceneInput scene;
  scene.force_limit_n = 3.3;
  scene.models.resize(1);
  render::ModelInput& model = scene.models[0];
  model.name = "sinusoid";
  model.cloud = std::make_shared<const cloud::Cloud>(std::move(generated->cloud));
  model.original_mesh = generated->original_mesh;
  model.analytic = generated->surface;
  const std::vector<Vec3> path = weaving_path(*model.analytic);

  render::Registry registry;
  register_all_renderers(registry);
  example::register_ball(registry);
  ASSERT_GE(registry.all().size(), 2u) << "no renderer is registered";

  for (const render::RendererInfo& info : registry.all()) {
    SCOPED_TRACE(info.name);
    auto renderer = registry.make(info.name, {});
    ASSERT_TRUE(renderer.ok()) << renderer.error().message();
    const auto prepared = (*renderer)->prepare(scene, {});
    ASSERT_TRUE(prepared.ok()) << prepared.error().message();

    std::size_t in_contact = 0;
    (*renderer)->reset(path.front());
    const AllocationCount count;
    for (const Vec3& hip_mm : path) in_contact += (*renderer)->step(hip_mm, 1e-3).contact;
    const std::uint64_t blocks = count.count();
    EXPECT_EQ(blocks, 0u);
    EXPECT_GT(in_contact, kFrames / 10) << "the path must be felt";
    if (info.name != "ball") {
      EXPECT_LT(in_contact, kFrames) << "and left";
    }
  }
}

}  // namespace
}  // namespace palpate::house
