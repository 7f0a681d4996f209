#include "toolkit/smooth/shared_tiles.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace palpate::render {
namespace {

constexpr float kLeastWeight = 1e-6f;
/// Half of a tile's edge, between its outer nodes, and half of its diagonal, in voxels.
constexpr double kHalfTile = 1.5, kHalfTileDiagonal = 2.5980762;
/// Curvature moves no foot farther along the tangent plane than this, in voxels, from where nodes count.
constexpr double kMostFootRoom = 1.0;
/// Floats of some ten voxels are rounded to a millionth of one; tests of reach allow a hundred times that.
constexpr double kReachRoom = 1e-4;

/// How far a tile's nodes are at most from its middle, square to n.
double tile_radius(const Vec3& n) {
  const double most = n.cwiseAbs().maxCoeff(), least_along = 2.0 * most - n.cwiseAbs().sum();
  const double along = kHalfTile * std::max(least_along, 0.0);
  return std::sqrt(kHalfTileDiagonal * kHalfTileDiagonal - along * along);
}

/// A bound of what a foot is moved by, in voxels: of a node `reach` off the middle along the tangent plane
/// and `above` off along the normal the slope is at most bend * reach, the drop above + bend * reach^2 / 2.
double foot_room(double bend, double reach, double above) {
  const double slope = bend * reach;
  return std::min(slope * (above + 0.5 * slope * reach), kMostFootRoom) + kReachRoom;
}

std::array<float, 3> floats(const Vec3& x) {
  return {static_cast<float>(x.x()), static_cast<float>(x.y()), static_cast<float>(x.z())};
}

/// Of a tile's nodes, in voxels from the grid's low corner.
Vec3 middle_of(const BrickGrid::Coordinate& tile) {
  return kTileNodes * Vec3(tile[0], tile[1], tile[2]) + Vec3::Constant(kHalfTile - 1.0);
}

std::size_t hash_of(const BrickGrid::Coordinate& c) {
  // Neighbours in ten bits: four of x, and three of y and z each.
  const auto low = [&](std::size_t axis, unsigned bits) {
    return static_cast<std::size_t>(c[axis]) & ((std::size_t{1} << bits) - 1);
  };
  return low(0, 4) | low(1, 3) << 4 | low(2, 3) << 7;
}

}  // namespace

double reach_of_tiles(const Vec3& normal) {
  // Eight tiles are a cube of twice the nodes: from its middle to theirs and on to their nodes.
  constexpr double kHalfTiles = kHalfTile + 0.5 * kTileNodes;
  return kHalfTiles / kHalfTile * tile_radius(normal) + kMostFootRoom + kReachRoom;
}

void SharedTiles::forget() {
  heads_.fill(kNone);
  kept_.clear();
  lists_.clear();
}

const SharedTiles::Form& SharedTiles::form_of(std::uint32_t patch) {
  std::uint32_t& number = form_[patch];
  if (number != kNone) return forms_[number];
  number = static_cast<std::uint32_t>(forms_.size());
  const Patch& p = patches_[patch];
  const Quadric& q = p.quadric;
  Form& form = forms_.emplace_back();
  form.at = grid_.in_voxels(q.at);
  form.support = p.support * grid_.per_voxel;
  // The height's second derivatives are no larger in any direction than their root sum of squares.
  form.bend = std::sqrt(4.0 * (q.uu * q.uu + q.vv * q.vv) + 2.0 * q.uv * q.uv) * grid_.voxel_mm;
  form.tile_radius = tile_radius(q.n);
  TilePatch& out = form.tile;
  out.u = floats(q.u);
  out.v = floats(q.v);
  out.n = floats(q.n);
  out.uu = static_cast<float>(q.uu * grid_.voxel_mm);
  out.uv = static_cast<float>(q.uv * grid_.voxel_mm);
  out.vv = static_cast<float>(q.vv * grid_.voxel_mm);
  out.trust = static_cast<float>(p.trust);
  out.support = static_cast<float>(form.support);
  out.per_support_sq = 1.0f / (out.support * out.support);
  // A cubic B-spline blurs by a sixth of the second difference along each axis: what it takes is added
  // beforehand. The distance's Laplacian is minus twice the sum of the height's curvatures.
  out.sharpen = without_.sharpening ? 0.0f : (out.uu + out.vv) / 3.0f;
  const float mean = out.uu + out.vv, half = std::hypot(out.uu - out.vv, out.uv);
  const float most = mean + half, least = mean - half;  // the principal curvatures
  out.bend = std::abs(most) > std::abs(least) ? most : least;
  return form;
}

void SharedTiles::take_face(std::span<const std::uint32_t> patches) {
  face_.assign(patches.begin(), patches.end());
  for (std::vector<double>& lane : lanes_) lane.resize(patches.size());
  for (std::size_t i = 0; i < patches.size(); ++i) {
    const Form& form = form_of(patches[i]);
    const Vec3& normal = patches_[patches[i]].quadric.n;
    for (std::size_t a = 0; a < 3; ++a) {
      lanes_[a][i] = form.at[static_cast<Eigen::Index>(a)];
      lanes_[3 + a][i] = normal[static_cast<Eigen::Index>(a)];
    }
    const double most = form.support + form.tile_radius + kMostFootRoom;
    lanes_[6][i] = most * most;
  }
}

void SharedTiles::find_here(const BrickGrid::Coordinate& place) {
  const Vec3 middle = middle_of(place);
  const std::size_t count = face_.size();
  // Most of a cube's patches are far from most of its tiles: those are told first, without branches.
  const double mx = middle.x(), my = middle.y(), mz = middle.z();
  const double *const x = lanes_[0].data(), *const y = lanes_[1].data(), *const z = lanes_[2].data();
  const double *const nx = lanes_[3].data(), *const ny = lanes_[4].data(), *const nz = lanes_[5].data();
  const double* const most_sq = lanes_[6].data();
  near_.resize(count + 1);
  lanes_[7].resize(count);
  double* const beyond = lanes_[7].data();
  for (std::size_t i = 0; i < count; ++i) {
    const double dx = x[i] - mx, dy = y[i] - my, dz = z[i] - mz;
    const double along = dx * nx[i] + dy * ny[i] + dz * nz[i];
    beyond[i] = dx * dx + dy * dy + dz * dz - along * along - most_sq[i];
  }
  std::size_t near = 0;
  for (std::size_t i = 0; i < count; ++i) {
    near_[near] = static_cast<std::uint32_t>(i);
    near += beyond[i] <= 0.0 ? std::size_t{1} : std::size_t{0};
  }
  here_.resize(near);
  for (std::size_t k = 0; k < near; ++k) here_[k] = face_[near_[k]];
}

bool SharedTiles::same_patches(const Kept& kept) const {
  return kept.count == here_.size() && std::equal(here_.begin(), here_.end(), lists_.begin() + kept.first);
}

const Tile& SharedTiles::at(const BrickGrid::Coordinate& place) {
  find_here(place);
  const std::size_t hash = hash_of(place);
  for (std::uint32_t k = heads_[hash]; k != kNone; k = kept_[k].next)
    if (kept_[k].place == place && same_patches(kept_[k])) return kept_[k].tile;
  if (kept_.size() == kMostTiles) forget();
  const auto number = static_cast<std::uint32_t>(kept_.size());
  Kept& kept = kept_.emplace_back();
  kept.place = place;
  kept.first = static_cast<std::uint32_t>(lists_.size());
  kept.count = static_cast<std::uint32_t>(here_.size());
  kept.next = std::exchange(heads_[hash], number);
  lists_.insert(lists_.end(), here_.begin(), here_.end());
  work_out(place, kept.tile);
  return kept.tile;
}

void SharedTiles::work_out(const BrickGrid::Coordinate& place, Tile& tile) const {
  const Vec3 middle = middle_of(place);
  TileSums sums{};
  for (const std::uint32_t here : here_) {
    TilePatch patch;
    if (!put_in_tile(here, middle, patch)) continue;
    if (!without_.blend) {
      add_to_tile(patch, sums);
      continue;
    }
    // Without blending: where a patch counts more than those before it, it counts alone.
    TileSums one{};
    add_to_tile(patch, one);
    for (std::size_t i = 0; i < kTileCount; ++i) {
      if (!(one.weight[i] > sums.weight[i])) continue;
      sums.weight[i] = one.weight[i];
      sums.distance[i] = one.distance[i];
      sums.x[i] = one.x[i];
      sums.y[i] = one.y[i];
      sums.z[i] = one.z[i];
    }
  }
  for (std::size_t i = 0; i < kTileCount; ++i) {
    const bool known = sums.weight[i] > kLeastWeight;
    const float per = known ? 1.0f / sums.weight[i] : 0.0f;
    tile.known[i] = known ? 1 : 0;
    tile.distance[i] = sums.distance[i] * per;
    tile.x[i] = sums.x[i] * per;
    tile.y[i] = sums.y[i] * per;
    tile.z[i] = sums.z[i] * per;
  }
}

bool SharedTiles::put_in_tile(std::uint32_t patch, const Vec3& middle, TilePatch& out) const {
  const Form& form = forms_[form_[patch]];
  const Vec3 away = form.at - middle;
  const double along = away.dot(patches_[patch].quadric.n);
  const double lateral_sq = away.squaredNorm() - along * along;
  const double room = foot_room(form.bend, form.support + kMostFootRoom, std::abs(along) + kHalfTileDiagonal);
  const double reach = form.support + form.tile_radius + room;
  if (lateral_sq > reach * reach) return false;
  out = form.tile;
  out.at = floats(away);
  out.foot_room = static_cast<float>(room);
  return true;
}

}  // namespace palpate::render
