// Which patches of a cube are one sheet, where creases tell their faces apart.
#include "toolkit/smooth/cube_faces.h"

#include <gtest/gtest.h>

#include <numeric>
#include <vector>

namespace palpate::render {
namespace {

constexpr double kHalf = 5.0;

Patch patch(const Vec3& at, const Vec3& normal) {
  Patch p;
  p.quadric.at = at;
  turn_to(p.quadric, normal.normalized());
  p.support = p.reached = 3.0;
  p.spacing = 1.0;
  p.points = 50;
  p.sure = true;
  return p;
}

/// Two faces of three patches each, linked within, and the last of either by a crease.
class TwoFaces {
 public:
  TwoFaces(std::vector<Patch> patches, Turn turn) : patches_(std::move(patches)) {
    const std::vector<std::vector<std::uint32_t>> to = {{1}, {0, 2}, {1, 5}, {4}, {3, 5}, {2, 4}};
    links_.begin = {0};
    for (std::uint32_t i = 0; i < to.size(); ++i) {
      for (const std::uint32_t j : to[i]) {
        links_.to.push_back(j);
        links_.turn.push_back(i * j == 10 ? turn : Turn::kNone);
      }
      links_.begin.push_back(static_cast<std::uint32_t>(links_.to.size()));
    }
    links_.sheet.assign(to.size(), 0);
    std::vector<std::uint32_t> members(to.size());
    std::iota(members.begin(), members.end(), 0u);
    faces_.part(members, patches_, links_, Vec3::Zero(), kHalf);
  }
  [[nodiscard]] bool one_sheet() const { return faces_.sheet(0) == faces_.sheet(3); }
  [[nodiscard]] bool whole_faces() const {
    return faces_.face(0) == faces_.face(1) && faces_.face(1) == faces_.face(2) &&
           faces_.face(3) == faces_.face(4) && faces_.face(4) == faces_.face(5) &&
           faces_.face(0) != faces_.face(3) && faces_.sheet(0) == faces_.sheet(2) &&
           faces_.sheet(3) == faces_.sheet(5);
  }

 private:
  std::vector<Patch> patches_;
  PatchLinks links_;
  CubeFaces faces_;
};

std::vector<Patch> walls(double side) {
  std::vector<Patch> out;
  for (const double z : {2.5, -2.5})
    for (const double x : {-2.0, 0.0, 2.0})
      out.push_back(patch({x, 0.0, z}, {0.0, 0.0, z > 0.0 ? side : -side}));
  return out;
}

TEST(CubeFaces, ARoofIsOneSheet) {
  std::vector<Patch> roof;
  for (const double side : {-1.0, 1.0})
    for (const double x : {4.0, 2.5, 1.0}) roof.push_back(patch({side * x, 0.0, -x}, {side, 0.0, 1.0}));
  const TwoFaces faces(roof, Turn::kRidge);
  EXPECT_TRUE(faces.one_sheet());
  EXPECT_TRUE(faces.whole_faces());
}

// A crease somewhere beside two walls says how they meet there: where it would hide them all along, they are
// two sheets.
TEST(CubeFaces, ACreaseHidesNoWalls) {
  for (const double side : {-1.0, 1.0}) {
    const Turn hides = side > 0.0 ? Turn::kValley : Turn::kRidge,
               shows = side > 0.0 ? Turn::kRidge : Turn::kValley;
    EXPECT_FALSE(TwoFaces(walls(side), hides).one_sheet());
    EXPECT_TRUE(TwoFaces(walls(side), hides).whole_faces());
    EXPECT_TRUE(TwoFaces(walls(side), shows).one_sheet());
  }
}

}  // namespace
}  // namespace palpate::render
