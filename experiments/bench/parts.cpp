#include "experiments/bench/cases.h"

#include <fmt/format.h>

#include <array>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>
#include <set>
#include <vector>

#include "toolkit/geometry/triangle_meshes.h"

namespace palpate::experiments {
namespace {

using geometry::TriangleMesh;
using std::numbers::pi;
using Cube = std::array<int, 3>;  ///< its lowest corner
using Ring = std::vector<Vec3>;

// ---- what parts are made of

/// The closed surface through rings of equally many points, the last ring joined to the first.
TriangleMesh around(const std::vector<Ring>& rings) {
  TriangleMesh mesh;
  const std::size_t size = rings.front().size();
  for (const Ring& ring : rings) mesh.vertices_mm.insert(mesh.vertices_mm.end(), ring.begin(), ring.end());
  const auto add = [&](std::size_t a, std::size_t b, std::size_t c) {
    mesh.triangles.push_back(
        {static_cast<std::uint32_t>(a), static_cast<std::uint32_t>(b), static_cast<std::uint32_t>(c)});
  };
  for (std::size_t i = 0; i < rings.size(); ++i) {
    const std::size_t here = i * size, there = (i + 1) % rings.size() * size;
    for (std::size_t j = 0; j < size; ++j) {
      const std::size_t k = (j + 1) % size;
      add(here + j, there + j, there + k);
      add(here + j, there + k, here + k);
    }
  }
  return mesh;
}

using Bend = std::function<Vec3(const Vec3& corner)>;

/// The surface of unit cubes, each corner moved by `bend`.
TriangleMesh of_cubes(const std::set<Cube>& cubes, const Bend& bend) {
  TriangleMesh mesh;
  std::map<Cube, std::uint32_t> index;
  const auto corner = [&](const Cube& at) {
    const auto [found, added] = index.try_emplace(at, static_cast<std::uint32_t>(mesh.vertices_mm.size()));
    if (added) mesh.vertices_mm.push_back(bend(Vec3(at[0], at[1], at[2])));
    return found->second;
  };
  constexpr std::array<std::array<int, 2>, 4> kSquare = {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}};
  for (const Cube& cube : cubes)
    for (std::size_t axis = 0; axis < 3; ++axis)
      for (const int side : {0, 1}) {
        Cube beside = cube;
        beside[axis] += side == 1 ? 1 : -1;
        if (cubes.contains(beside)) continue;
        std::array<std::uint32_t, 4> square{};
        for (std::size_t k = 0; k < square.size(); ++k) {
          Cube at = cube;
          at[axis] += side;
          at[(axis + 1) % 3] += kSquare[k][0];
          at[(axis + 2) % 3] += kSquare[k][1];
          square[k] = corner(at);
        }
        if (side == 0) std::swap(square[1], square[3]);
        mesh.triangles.push_back({square[0], square[1], square[2]});
        mesh.triangles.push_back({square[0], square[2], square[3]});
      }
  return mesh;
}

/// Adds the cubes from `low` up to before `high` that `keep` keeps.
void add_cubes(std::set<Cube>& cubes, const Cube& low, const Cube& high,
               const std::function<bool(const Cube&)>& keep = {}) {
  for (int x = low[0]; x < high[0]; ++x)
    for (int y = low[1]; y < high[1]; ++y)
      for (int z = low[2]; z < high[2]; ++z)
        if (const Cube cube{x, y, z}; !keep || keep(cube)) cubes.insert(cube);
}

/// The direction of `a` without its part along the unit vector `along`.
Vec3 across(const Vec3& a, const Vec3& along) {
  return (a - a.dot(along) * along).normalized();
}

/// A tube around a closed line; `radius` of the share of the way along it and of the share of the way around.
TriangleMesh tube(const Ring& centres, const std::function<double(double, double)>& radius,
                  std::size_t sides) {
  const std::size_t count = centres.size();
  const auto along = [&](std::size_t i) {
    return Vec3((centres[(i + 1) % count] - centres[(i + count - 1) % count]).normalized());
  };
  // A frame is turned no more than the line bends; the first one's direction is any that is not along the
  // line.
  std::vector<Vec3> normals = {across(along(0).cross(Vec3(0.3, 0.5, 0.8)), along(0))};
  while (normals.size() < count) normals.push_back(across(normals.back(), along(normals.size())));
  // Back at the start the frame is turned by an angle, which is spread over the whole way.
  const Vec3 last = across(normals.back(), along(0));
  const double twist = std::atan2(last.dot(along(0).cross(normals[0])), last.dot(normals[0]));
  std::vector<Ring> rings(count);
  for (std::size_t i = 0; i < count; ++i) {
    const double at = static_cast<double>(i) / static_cast<double>(count);
    const Vec3 beside = along(i).cross(normals[i]);
    for (std::size_t j = 0; j < sides; ++j) {
      const double turn = static_cast<double>(j) / static_cast<double>(sides);
      const double angle = 2.0 * pi * turn - twist * at;
      rings[i].push_back(centres[i] +
                         radius(at, turn) * (std::cos(angle) * normals[i] + std::sin(angle) * beside));
    }
  }
  return around(rings);
}

// ---- the parts, in units of their own

TriangleMesh bent_comb(Dimensions& d) {
  constexpr int kLength = 60, kDepth = 5, kBack = 8;
  const int tip = d.count(36, 32, 40), pitch = d.count(5, 5, 6), tooth = d.count(2, 2, 3);
  const double radius = d.length(60.0), half_angle = d.length(0.7), wave = d.length(2.0);
  std::set<Cube> cubes;
  add_cubes(cubes, {0, 0, 0}, {kLength, kDepth, kBack});
  add_cubes(cubes, {0, 0, kBack}, {kLength, kDepth, tip},
            [&](const Cube& c) { return c[0] % pitch < tooth; });
  return of_cubes(cubes, [&](const Vec3& p) {
    const double angle = half_angle * (p.x() / kLength * 2.0 - 1.0);
    return Vec3((radius + p.y()) * std::sin(angle), (radius + p.y()) * std::cos(angle),
                p.z() + wave * std::sin(angle * 3.0));
  });
}

TriangleMesh ribs_and_bracket(Dimensions& d) {
  constexpr int kLength = 40, kWidth = 30, kHeight = 30, kRibEnd = 20, kRibWidth = 3;
  constexpr int kHoleX = 28, kHoleY = 15;
  const int plate = d.count(5, 4, 6), rib_slope = d.count(25, 23, 27), rib = d.count(6, 5, 8),
            other_rib = d.count(22, 20, 23);
  const double hole = d.length(6.0), lean_x = d.length(0.21), lean_y = d.length(0.13), rise = d.length(0.17);
  std::set<Cube> cubes;
  add_cubes(cubes, {0, 0, 0}, {kLength, kWidth, plate},
            [&](const Cube& c) { return std::hypot(c[0] - kHoleX, c[1] - kHoleY) > hole; });
  add_cubes(cubes, {0, 0, plate}, {plate, kWidth, kHeight});
  for (const int y : {rib, other_rib})
    add_cubes(cubes, {plate, y, plate}, {kRibEnd, y + kRibWidth, kRibEnd},
              [&](const Cube& c) { return c[0] + c[2] < rib_slope; });
  return of_cubes(cubes, [&](const Vec3& p) {
    return Vec3(p.x() + lean_x * p.y(), p.y() - lean_y * p.z(), p.z() + rise * p.x());
  });
}

/// The channel through the foot, narrower than a hair, makes the profile's ring close without a pole.
TriangleMesh vase(Dimensions& d) {
  constexpr double kHeight = 100.0, kFoot = 4.0, kChannel = 0.02;
  constexpr std::size_t kSteps = 80, kAround = 200;
  const double half_wall = d.length(1.2), radius = d.length(28.0), swell = d.length(14.0),
               bend = d.length(3.2);
  const auto middle = [&](double t) { return radius + swell * std::sin(bend * t) * (1.0 - t * 0.3); };
  std::vector<std::array<double, 2>> profile;  // radius, height
  const auto share = [](std::size_t i) { return static_cast<double>(i) / (kSteps - 1); };
  for (std::size_t i = 0; i < kSteps; ++i)
    profile.push_back({middle(share(i)) + half_wall, kHeight * share(i)});
  for (std::size_t i = kSteps; i-- > 1;)
    profile.push_back({middle(share(i)) - half_wall, std::max(kHeight * share(i), kFoot)});
  profile.push_back({kChannel, kFoot});
  profile.push_back({kChannel, 0.0});
  std::vector<Ring> rings(kAround);
  for (std::size_t i = 0; i < kAround; ++i) {
    const double angle = 2.0 * pi * static_cast<double>(i) / kAround;
    for (const auto& [r, z] : profile) rings[i].emplace_back(r * std::cos(angle), r * std::sin(angle), z);
  }
  return around(rings);
}

TriangleMesh knotted_cable(Dimensions& d) {
  constexpr std::size_t kSteps = 900, kSides = 60;
  constexpr double kScale = 20.0;
  const double rise = d.length(14.0), radius = d.length(5.5), groove = d.length(0.8);
  const int strands = d.count(5, 4, 6), turns = d.count(24, 20, 28);
  Ring centres;
  for (std::size_t i = 0; i < kSteps; ++i) {
    const double u = 2.0 * pi * static_cast<double>(i) / kSteps;
    const double out = 2.0 + std::cos(3.0 * u);
    centres.emplace_back(out * std::cos(2.0 * u) * kScale, out * std::sin(2.0 * u) * kScale,
                         rise * std::sin(3.0 * u));
  }
  return tube(
      centres,
      [&](double u, double v) { return radius + groove * std::cos(2.0 * pi * (strands * v + turns * u)); },
      kSides);
}

TriangleMesh cog(Dimensions& d) {
  constexpr std::uint32_t kPitch = 10, kBladeFrom = 30, kBladeTo = 34;  // in steps; the blade is on a tooth
  const auto steps = kPitch * static_cast<std::uint32_t>(d.count(14, 13, 16));
  const double thickness = d.length(30.0), root = d.length(40.0), tooth = d.length(6.0),
               saddle = d.length(0.1), blade = d.length(20.0);
  TriangleMesh mesh;
  for (const double z : {0.0, thickness})
    for (std::uint32_t i = 0; i < steps; ++i) {
      const double angle = 2.0 * pi * i / steps;
      const double r =
          root + (i % kPitch < kPitch / 2 ? tooth : 0.0) + (i >= kBladeFrom && i < kBladeTo ? blade : 0.0);
      mesh.vertices_mm.emplace_back(r * std::cos(angle), r * std::sin(angle),
                                    z + saddle * r * std::cos(2.0 * angle));
    }
  const std::uint32_t below = 2 * steps, above = below + 1;
  mesh.vertices_mm.emplace_back(0.0, 0.0, 0.0);
  mesh.vertices_mm.emplace_back(0.0, 0.0, thickness);
  for (std::uint32_t i = 0; i < steps; ++i) {
    const std::uint32_t j = (i + 1) % steps;
    for (const auto& face : {std::array{i, j, steps + j}, std::array{i, steps + j, steps + i},
                             std::array{below, j, i}, std::array{above, steps + i, steps + j}})
      mesh.triangles.push_back(face);
  }
  return mesh;
}

TriangleMesh leaning_fins(Dimensions& d) {
  constexpr int kSide = 50, kPlate = 3, kRim = 4, kFirst = 2;
  const int tip = d.count(24, 21, 27), pitch = d.count(7, 6, 8);
  const double lean = d.length(0.45), wave = d.length(1.5);
  std::set<Cube> cubes;
  add_cubes(cubes, {0, 0, 0}, {kSide, kSide, kPlate});
  add_cubes(cubes, {kFirst, kRim, kPlate}, {kSide - kFirst, kSide - kRim, tip},
            [&](const Cube& c) { return c[0] % pitch == kFirst; });
  return of_cubes(cubes, [&](const Vec3& p) {
    return Vec3(p.x() + lean * std::max(p.z() - kPlate, 0.0), p.y() + wave * std::sin(p.x() * 0.2), p.z());
  });
}

constexpr std::array kBenchParts = {
    BenchPart{"bent-comb", "a back of 60 x 5 x 8 with twelve teeth two thick and three apart, bent and waved",
              bent_comb},
    BenchPart{"ribs-and-bracket",
              "an L of plates five thick, a hole in one, two ribs between them, all askew", ribs_and_bracket},
    BenchPart{"vase", "a wall 2.4 thick and 100 high, turned, on a foot four thick", vase},
    BenchPart{"knotted-cable", "a trefoil of a cable of five twisted strands", knotted_cable},
    BenchPart{"cog", "a wheel of fourteen teeth with a blade on one, its faces curved as a saddle", cog},
    BenchPart{"leaning-fins", "seven fins one thick and seven apart on a plate, leaning and waved",
              leaning_fins}};

// ---- meshes as a whole

double signed_volume(const TriangleMesh& mesh) {
  double six = 0.0;
  for (const auto& [a, b, c] : mesh.triangles)
    six += mesh.vertices_mm[a].dot(mesh.vertices_mm[b].cross(mesh.vertices_mm[c]));
  return six / 6.0;
}

double nine_digits(double x) {
  return std::stod(fmt::format("{:.9g}", x));
}

}  // namespace

std::span<const BenchPart> bench_parts() {
  return kBenchParts;
}

TriangleMesh make_part(const BenchPart& part, Dimensions dimensions) {
  TriangleMesh mesh = part.shape(dimensions);
  Vec3 sum = Vec3::Zero();
  geometry::Aabb box;
  for (const Vec3& p : mesh.vertices_mm) {
    sum += p;
    box.add(p);
  }
  const Vec3 middle = sum / static_cast<double>(mesh.vertices_mm.size());
  const double scale = kPartExtentMm / (box.high_mm - box.low_mm).maxCoeff();
  for (Vec3& p : mesh.vertices_mm) p = (scale * (p - middle)).unaryExpr(&nine_digits);
  if (signed_volume(mesh) < 0.0)
    for (auto& face : mesh.triangles) std::swap(face[1], face[2]);
  return mesh;
}

std::string faults_of(const TriangleMesh& mesh) {
  // Less than a thousandth of the smallest face, a vase's channel's, and more than nine digits round away.
  constexpr double kLeastArea = 5e-11 * kPartExtentMm * kPartExtentMm;
  std::map<std::array<std::uint32_t, 2>, int> ways;
  std::size_t flat = 0;
  for (const auto& face : mesh.triangles) {
    for (std::size_t k = 0; k < 3; ++k) ++ways[{face[k], face[(k + 1) % 3]}];
    const Vec3 &a = mesh.vertices_mm[face[0]], &b = mesh.vertices_mm[face[1]], &c = mesh.vertices_mm[face[2]];
    if ((b - a).cross(c - a).norm() / 2.0 < kLeastArea) ++flat;
  }
  std::size_t open = 0;
  for (const auto& [way, passed] : ways)
    if (passed != 1 || !ways.contains({way[1], way[0]})) ++open;
  std::string faults;
  const auto add = [&](std::size_t count, const char* what) {
    if (count > 0) faults += fmt::format("{}{} {}", faults.empty() ? "" : "; ", count, what);
  };
  add(open, "edges not passed once each way");
  add(flat, "faces without area");
  add(signed_volume(mesh) > 0.0 ? 0 : 1, "volume that is not positive");
  return faults;
}

}  // namespace palpate::experiments
