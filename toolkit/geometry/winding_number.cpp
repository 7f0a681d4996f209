#include "toolkit/geometry/winding_number.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

#include "toolkit/core/parallel.h"

namespace palpate::geometry {
namespace {

/// A part acts as a point only beyond half its width, sqrt(area).
constexpr double kSoftShare = 0.25;
/// Surface places that are sampled, and the fewest parts for a decision.
constexpr std::size_t kPlaces = 64, kMinElements = 16;
/// From a place on a closed surface the rest covers half of all directions, from an open half ball a quarter,
/// from a plane none. Above three quarters of a half a piece counts as closed.
constexpr double kEnclosingThreshold = 0.75 * 0.5;
/// Places evaluated together, to compute each part's width once.
constexpr std::size_t kTogether = 8;
/// Parts of a leaf. A node counts by its sum from so many of its radii on: the next term of the series is a
/// ninth of the sum's share, and those of neighbours cancel.
constexpr std::size_t kLeafParts = 8;
constexpr double kFarRadii = 3.0;

/// winding_number() of each place.
template <std::size_t kCount>
std::array<double, kCount> winding_numbers(std::span<const AreaElement> parts,
                                           const std::array<Vec3, kCount>& places) noexcept {
  std::array<double, kCount> x, y, z, sum{};
  for (std::size_t k = 0; k < kCount; ++k) {
    x[k] = places[k].x();
    y[k] = places[k].y();
    z[k] = places[k].z();
  }
  for (const AreaElement& part : parts) {
    const Vec3 middle = part.middle.cast<double>(), area = part.area.cast<double>();
    const double soft = kSoftShare * area.norm();
    for (std::size_t k = 0; k < kCount; ++k) {
      const double dx = middle.x() - x[k], dy = middle.y() - y[k], dz = middle.z() - z[k];
      const double sq = ((dx * dx + dy * dy) + dz * dz) + soft;
      const double seen = ((area.x() * dx + area.y() * dy) + area.z() * dz) / (sq * std::sqrt(sq));
      sum[k] += sq > 0.0 ? seen : 0.0;
    }
  }
  for (double& share : sum) share /= 4.0 * std::numbers::pi;
  return sum;
}

}  // namespace

double winding_number(std::span<const AreaElement> parts, const Vec3& at) noexcept {
  return winding_numbers<1>(parts, {at}).front();
}

SurfaceParts::SurfaceParts(std::vector<AreaElement> parts) : parts_(std::move(parts)) {
  nodes_.reserve(4 * (parts_.size() / kLeafParts + 1));
  if (!parts_.empty()) build(0, parts_.size());
}

SurfaceParts::Box SurfaceParts::build(std::size_t first, std::size_t past) {
  const std::size_t at = nodes_.size();
  nodes_.emplace_back();
  Box box;
  Vec3 area = Vec3::Zero(), middle = Vec3::Zero();
  double weight = 0.0;
  const auto add = [&](const AreaElement& part, double size) {
    area += part.area.cast<double>();
    middle += size * part.middle.cast<double>();
    weight += size;
  };
  if (past - first <= kLeafParts) {
    nodes_[at].first = static_cast<std::uint32_t>(first);
    nodes_[at].count = static_cast<std::uint32_t>(past - first);
    box = {parts_[first].middle, parts_[first].middle};
    for (const AreaElement& part : elements().subspan(first, past - first)) {
      const Eigen::Vector3f half = Eigen::Vector3f::Constant(0.5f * std::sqrt(part.area.norm()));
      box = {box.low.cwiseMin(part.middle - half), box.high.cwiseMax(part.middle + half)};
      add(part, 1.0);
    }
  } else {
    const std::size_t half = first + (past - first) / 2, left = nodes_.size();
    const Box a = build(first, half);
    const std::size_t right = nodes_.size();
    const Box b = build(half, past);
    box = {a.low.cwiseMin(b.low), a.high.cwiseMax(b.high)};
    add(nodes_[left].sum, static_cast<double>(half - first));
    add(nodes_[right].sum, static_cast<double>(past - half));
  }
  Node& node = nodes_[at];
  node.sum = {Vec3(middle / weight).cast<float>(), area.cast<float>()};
  node.radius = (node.sum.middle - box.low).cwiseMax(box.high - node.sum.middle).norm();
  node.after = static_cast<std::uint32_t>(nodes_.size());
  return box;
}

double SurfaceParts::winding_number(const Vec3& at) const noexcept {
  double sum = 0.0;
  for (std::size_t i = 0; i < nodes_.size();) {
    const Node& node = nodes_[i];
    const Vec3 to = node.sum.middle.cast<double>() - at;
    const double distance_sq = to.squaredNorm(), far = kFarRadii * static_cast<double>(node.radius);
    if (distance_sq > far * far) {
      sum += node.sum.area.cast<double>().dot(to) /
             (distance_sq * std::sqrt(distance_sq) * 4.0 * std::numbers::pi);
      i = node.after;
    } else if (node.count > 0) {
      sum += geometry::winding_number(elements().subspan(node.first, node.count), at);
      i = node.after;
    } else {
      ++i;
    }
  }
  return sum;
}

float normal_orientation(std::span<const AreaElement> parts, int threads) {
  if (parts.size() < kMinElements) return 0.0f;
  std::array<double, kPlaces> share{};
  static_assert(kPlaces % kTogether == 0);
  parallel_chunks(kPlaces, kTogether, threads, [&](std::size_t begin, std::size_t) {
    std::array<Vec3, kTogether> places;
    for (std::size_t k = 0; k < kTogether; ++k)
      places[k] = parts[parts.size() * (2 * (begin + k) + 1) / (2 * kPlaces)].middle.cast<double>();
    const std::array<double, kTogether> these = winding_numbers<kTogether>(parts, places);
    std::copy(these.begin(), these.end(), share.begin() + static_cast<std::ptrdiff_t>(begin));
  });
  // The median: where faces are close, single places see too much or too little.
  const auto middle = share.begin() + kPlaces / 2;
  std::nth_element(share.begin(), middle, share.end());
  return *middle > kEnclosingThreshold ? 1.0f : *middle < -kEnclosingThreshold ? -1.0f : 0.0f;
}

}  // namespace palpate::geometry
