// Height fields with posts that have no point: over gaps the surface goes on, over voids there is none.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>

#include "tests/toolkit/cloud/posts.h"
#include "tests/toolkit/renderers/scenes.h"
#include "toolkit/core/random.h"
#include "toolkit/render/registry.h"
#include "toolkit/renderers/toolkit_renderers.h"

namespace palpate::render {
namespace {

constexpr std::size_t kColumns = 60, kRows = 50;
using Gone = std::function<bool(std::size_t column, std::size_t row)>;

/// How a sheet of posts lies in the world.
struct Lie {
  double scale = 1.0;   ///< of everything
  double step_y = 1.0;  ///< columns are one apart
  Vec3 corner = Vec3::Zero();
  geometry::RigidTransform pose;
};

double wave(double x, double y) {
  return 2.0 * std::cos(0.1 * x) * std::cos(0.1 * y);
}

SceneInput sheet(const Gone& gone, const Lie& lie = {}) {
  std::vector<Vec3> points;
  for (std::size_t row = 0; row < kRows; ++row)
    for (std::size_t column = 0; column < kColumns; ++column) {
      if (gone(column, row)) continue;
      const double x = static_cast<double>(column), y = lie.step_y * static_cast<double>(row);
      points.push_back(lie.scale * (lie.corner + Vec3(x, y, wave(x, y / lie.step_y))));
    }
  SceneInput scene = cloud_of(points);
  scene.models[0].surface.stiffness_n_per_mm = 1.0 / lie.scale;
  scene.models[0].world_from_model = lie.pose;
  return scene;
}

bool nothing(std::size_t, std::size_t) {
  return false;
}

const std::map<std::string, Gone>& patterns() {
  static const std::map<std::string, Gone> all = {
      {"5 %", [](std::size_t c, std::size_t r) { return Random(1000 * c + r + 3).uniform() < 0.05; }},
      {"30 %", [](std::size_t c, std::size_t r) { return Random(1000 * c + r + 4).uniform() < 0.3; }},
      {"70 %", [](std::size_t c, std::size_t r) { return Random(1000 * c + r + 5).uniform() < 0.7; }},
      {"clusters", [](std::size_t c, std::size_t r) { return c % 14 >= 5 && c % 14 < 10 && r % 13 < 5; }},
      {"a row", [](std::size_t, std::size_t r) { return r == 20; }},
      {"a column", [](std::size_t c, std::size_t) { return c == 31; }},
      {"a chessboard", [](std::size_t c, std::size_t r) { return (c + r) % 2 == 1; }},
      {"at the border", [](std::size_t c, std::size_t r) {
         return (r == 0 || r == kRows - 1 || c == 0 || c == kColumns - 1) && (c + r) % 3 == 1 && c + r > 1 &&
                c + r < kColumns + kRows - 3;
       }}};
  return all;
}

/// In and out of the sheet while crossing it, the k-th of `frames`: world frame.
Vec3 place(int k, const Lie& lie) {
  const double t = 0.001 * k;
  const double x = 29.5 + 26.0 * std::sin(2.3 * t), y = 24.5 + 21.0 * std::sin(3.7 * t + 0.4);
  const double over = 0.5 * std::cos(31.0 * t) - 0.3;
  return lie.pose * Vec3(lie.scale * (lie.corner + Vec3(x, lie.step_y * y, wave(x, y) + over)));
}

/// Frames of both along one path: how many contacts differ, and by how much the forces do at most.
struct Difference {
  int contacts = 0, contact_frames = 0;
  double force = 0.0;
};
Difference along_the_path(const test::Stepped& a, const test::Stepped& b, const Lie& lie) {
  constexpr int kFrames = 8000;
  Difference found;
  a->restart(place(0, lie));
  b->restart(place(0, lie));
  for (int k = 0; k < kFrames; ++k) {
    const Frame one = a->step(place(k, lie), 1e-3), other = b->step(place(k, lie), 1e-3);
    found.contacts += one.contact != other.contact;
    found.contact_frames += one.contact;
    if (one.contact && other.contact)
      found.force = std::max(found.force, (one.force_n - other.force_n).norm());
  }
  return found;
}

TEST(HeightFieldHoles, AGapIsFeltAsTheSurface) {
  const auto whole = prepared(sheet(nothing), "heightfield");
  for (const auto& [name, gone] : patterns()) {
    SCOPED_TRACE(name);
    const auto holed = prepared(sheet(gone), "heightfield");
    const Difference found = along_the_path(whole, holed, {});
    EXPECT_GT(found.contact_frames, 4000);
    // Heights differ by at most 0.02 (five of the wave's in AFilledWaveIsTheWave), at 0.03 mm a frame.
    EXPECT_LE(found.contacts, name == "70 %" ? 40 : 10);
    EXPECT_LT(found.force, 0.03) << "of up to 0.8 N";
    EXPECT_EQ(holed->counters().edges, 0u);
  }
}

TEST(HeightFieldHoles, ScaleAspectPlaceAndPoseChangeNothing) {
  const Gone gone = patterns().at("30 %");
  geometry::RigidTransform turned;
  turned.rotation = Eigen::Quaterniond(Eigen::AngleAxisd(0.7, Vec3(1, 2, -1).normalized()));
  turned.translation_mm = {10.0, -3.0, 2.0};
  for (const Lie& lie :
       {Lie{1e-3, 1.0, Vec3::Zero(), {}}, Lie{1e6, 1.0, Vec3::Zero(), {}}, Lie{1.0, 3.0, Vec3::Zero(), {}},
        Lie{1.0, 1.0, {4e5, -7e5, 1e4}, {}}, Lie{1.0, 1.0, Vec3::Zero(), turned}}) {
    SCOPED_TRACE(testing::Message() << lie.scale << " " << lie.step_y << " " << lie.corner.transpose());
    const auto whole = prepared(sheet(nothing, lie), "heightfield");
    const auto holed = prepared(sheet(gone, lie), "heightfield");
    const Difference found = along_the_path(whole, holed, lie);
    EXPECT_GT(found.contact_frames, 4000);
    EXPECT_LE(found.contacts, 10);
    EXPECT_LT(found.force, 0.03);
    EXPECT_EQ(holed->counters().edges, 0u);
  }
}

TEST(HeightFieldHoles, JitteredHeightsAreBridged) {
  const cloud::Heights ground = cloud::rough(0.5, 8);
  std::vector<Vec3> points;
  for (std::size_t row = 0; row < kRows; ++row)
    for (std::size_t column = 0; column < kColumns; ++column)
      if (!patterns().at("30 %")(column, row))
        points.emplace_back(static_cast<double>(column), static_cast<double>(row), ground(column, row));
  SceneInput scene = cloud_of(points);
  const auto renderer = prepared(scene, "heightfield");
  Random random(3);
  for (int i = 0; i < 500; ++i) {
    const double x = random.uniform(1.0, kColumns - 2.0), y = random.uniform(1.0, kRows - 2.0);
    renderer->restart({x, y, 3.0});
    EXPECT_FALSE(renderer->step({x, y, 2.0}, 1e-3).contact);
    ASSERT_TRUE(renderer->step({x, y, -1.0}, 1e-3).contact) << x << " " << y;
  }
}

TEST(HeightFieldHoles, EntryAndReleaseRightOverAHole) {
  const auto renderer =
      prepared(sheet([](std::size_t c, std::size_t r) { return c >= 28 && c < 33 && r >= 22 && r < 27; }),
               "heightfield");
  const double top = wave(30, 24);
  renderer->restart({30, 24, top + 1.0});
  bool before = false;
  int entries = 0, releases = 0;
  for (int k = 0; k <= 400; ++k) {
    const double over = std::cos(std::numbers::pi * k / 100.0);
    const Frame frame = renderer->step({30, 24, top + over}, 1e-3);
    if (std::abs(over) > 0.03) {
      EXPECT_EQ(frame.contact, over < 0.0) << over;
    }
    entries += frame.contact && !before;
    releases += !frame.contact && before;
    before = frame.contact;
  }
  EXPECT_EQ(entries, 2);
  EXPECT_EQ(releases, 2);
  EXPECT_EQ(renderer->counters().edges, 0u);
}

TEST(HeightFieldHoles, AGapHasTheSurfaceOfItsNearestPoint) {
  SceneInput scene = cloud_of(cloud::posts(kColumns, kRows, 1.0, [](std::size_t c, std::size_t r) {
    return c >= 28 && c < 33 && r == 24 ? std::numeric_limits<double>::quiet_NaN() : 0.0;
  }));
  auto properties = std::make_shared<surface::PointProperties>();
  for (std::size_t i = 0; i < scene.models[0].cloud->size(); ++i) {
    const bool left = scene.models[0].cloud->point_mm(i).x() < 29.5;
    properties->static_friction.push_back(left ? 0.6f : 0.2f);
    properties->dynamic_friction.push_back(left ? 0.6f : 0.2f);
    properties->stiffness_n_per_mm.push_back(0.25f);
  }
  scene.models[0].surface.stiffness_n_per_mm = 4.0;
  scene.models[0].surface.per_point = properties;
  const auto renderer = prepared(scene, "heightfield");
  for (const auto& [x, friction] : {std::pair{28.0, 0.6}, std::pair{32.0, 0.2}}) {
    renderer->restart({x, 23.0, 1.0});
    (void)renderer->step({x, 23.0, 1.0}, 1e-3);
    Frame frame;
    for (int k = 0; k <= 100; ++k) frame = renderer->step({x, 23.0 + 0.01 * k, -1.0}, 1e-3);
    EXPECT_NEAR(frame.force_n.z(), 0.25, 1e-6) << x;
    EXPECT_NEAR(frame.force_n.y(), -0.25 * friction, 1e-6) << x;
  }
}

TEST(HeightFieldHoles, AVoidIsFreeSpaceAndSaid) {
  Registry registry;
  register_toolkit_renderers(registry);
  const SceneInput scene =
      sheet([](std::size_t c, std::size_t r) { return c >= 20 && c < 32 && r >= 20 && r < 30; });
  const test::Stepped renderer = registry.make("heightfield", {}).value();
  const PrepareReport report = renderer->prepare(scene, {1, nullptr}).value();
  EXPECT_NE(report.notes.back().find("120 of them without a point"), std::string::npos)
      << report.notes.back();
  ASSERT_EQ(report.warnings.size(), 1u);
  EXPECT_NE(report.warnings[0].find("over 120 posts"), std::string::npos) << report.warnings[0];
  renderer->restart({26, 25, 5});
  EXPECT_FALSE(renderer->step({26, 25, -5}, 1e-3).contact) << "through the void";
  EXPECT_FALSE(renderer->step({10, 25, -5}, 1e-3).contact) << "under the sheet";
  EXPECT_EQ(renderer->counters().edges, 1u);
}

TEST(HeightFieldHoles, WhatIsStrewnThinlyIsRefusedWithARemedy) {
  const SceneInput scene =
      sheet([](std::size_t c, std::size_t r) { return Random(1000 * c + r + 5).uniform() < 0.92; });
  Registry registry;
  register_toolkit_renderers(registry);
  for (const char* name : {"heightfield", "heightfield-literal"}) {
    const auto report = registry.make(name, {}).value()->prepare(scene, {1, nullptr});
    ASSERT_FALSE(report) << name;
    EXPECT_NE(report.error().message().find("one post in 16"), std::string::npos);
    EXPECT_NE(report.error().remedy.find("cloud"), std::string::npos);
  }
}

// What is printed knows nothing of missing posts: over one nothing is felt, and it is counted.
TEST(HeightFieldHoles, ToTheLetterTheHipFallsThroughAndIsCounted) {
  for (const char* name : {"heightfield-literal", "heightfield-literal:response=lookup"}) {
    SCOPED_TRACE(name);
    const auto holed = prepared(sheet([](std::size_t c, std::size_t r) { return c == 30 && r == 24; }), name);
    const auto whole = prepared(sheet(nothing), name);
    EXPECT_FALSE(holed->step({30.2, 24.1, -3}, 1e-3).contact);
    EXPECT_EQ(holed->counters().edges, 1u);
    EXPECT_FALSE(holed->step({29.8, 24.1, -3}, 1e-3).contact) << "still there";
    EXPECT_EQ(holed->counters().edges, 1u);
    EXPECT_FALSE(holed->step({30.2, 24.1, 3}, 1e-3).contact) << "and out";
    EXPECT_FALSE(holed->step({30.2, 24.1, -3}, 1e-3).contact);
    EXPECT_EQ(holed->counters().edges, 2u);
    // Elsewhere as on a whole sheet, to the last bit.
    holed->restart({});
    for (int k = 0; k < 2000; ++k) {
      const Vec3 hip = place(k, {}) - Vec3(0, 0, 1);
      if (std::hypot(hip.x() - 30, hip.y() - 24) < 6.0) continue;
      const Frame one = holed->step(hip, 1e-3), other = whole->step(hip, 1e-3);
      ASSERT_EQ(one.contact, other.contact);
      ASSERT_EQ(one.force_n, other.force_n);
    }
  }
}

TEST(HeightFieldHoles, WhoFallsThroughIsWarned) {
  Registry registry;
  register_toolkit_renderers(registry);
  const auto warnings = [&](const std::string& spec, const Gone& gone) {
    const NamedOptions named = parse_named_options(spec).value();
    return registry.make(named.name, named.options).value()->prepare(sheet(gone), {1, nullptr})->warnings;
  };
  const Gone gone = patterns().at("5 %");
  EXPECT_TRUE(warnings("heightfield", gone).empty());
  EXPECT_TRUE(warnings("heightfield-literal", nothing).empty());
  for (const char* open : {"heightfield:holes=open", "heightfield-literal"}) {
    ASSERT_EQ(warnings(open, gone).size(), 1u) << open;
    EXPECT_NE(warnings(open, gone)[0].find("holes=fill"), std::string::npos) << open;
  }
}

TEST(HeightFieldHoles, NothingIsFilledWhereNothingIsAskedFor) {
  const auto renderer =
      prepared(sheet([](std::size_t c, std::size_t r) { return c >= 28 && c < 33 && r >= 22 && r < 27; }),
               "heightfield:holes=open");
  renderer->restart({30, 24, 5});
  EXPECT_FALSE(renderer->step({30, 24, -5}, 1e-3).contact);
}

}  // namespace
}  // namespace palpate::render
