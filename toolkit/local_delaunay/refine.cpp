#include "toolkit/local_delaunay/local_delaunay_mesh.h"

#include <Eigen/Geometry>  // cross products
#include <cmath>
#include <utility>
#include <vector>

#include "toolkit/core/parallel.h"
#include "toolkit/geometry/triangle_meshes.h"
#include "toolkit/local_delaunay/candidate_triangulation.h"
#include "toolkit/local_delaunay/spatial_sort.h"

namespace palpate::local_delaunay {
namespace {

/// Facets that turn by more than 40 degrees are separate faces; nine around a circle still count as round.
const double kCreaseCosine = std::cos(40.0 * M_PI / 180.0);

Vec3 facet_normal(const LocalDelaunayMesh& mesh, const Ring& ring, std::uint32_t place,
                  std::uint32_t sector) {
  const Vec3 p = mesh.at(place);
  const Vec3 n = (mesh.at(ring.of[sector]) - p).cross(mesh.at(ring.of[ring.next(sector)]) - p);
  const double size = n.norm();
  return size > 0.0 ? Vec3(n / size) : Vec3(Vec3::Zero());
}

/// A sector's share of the normal; exact if the ring lies on a sphere (Max 1999).
Vec3 weighted_normal(const LocalDelaunayMesh& mesh, const Ring& ring, std::uint32_t place,
                     std::uint32_t sector) {
  const Vec3 p = mesh.at(place);
  const Vec3 u = mesh.at(ring.of[sector]) - p, v = mesh.at(ring.of[ring.next(sector)]) - p;
  const double squares = u.squaredNorm() * v.squaredNorm();
  return squares > 0.0 ? Vec3(u.cross(v) / squares) : Vec3(Vec3::Zero());
}

bool is_smooth(const Vec3& a, const Vec3& b) noexcept {
  return a.dot(b) >= kCreaseCosine;
}

/// The unit normal at a place on the sheet of its ring's edge k, from the sectors on both sides up to the
/// next crease or border. Zero if the edge is a crease.
Vec3 normal_beside(const LocalDelaunayMesh& mesh, std::uint32_t place, std::uint32_t k) {
  const Ring ring = mesh.ring(place);
  const std::uint32_t left = k, right = ring.previous(k);
  const bool has_left = ring.has_sector(left), has_right = ring.has_sector(right);
  if (has_left && has_right &&
      !is_smooth(facet_normal(mesh, ring, place, left), facet_normal(mesh, ring, place, right)))
    return Vec3::Zero();
  Vec3 sum = Vec3::Zero();
  std::uint32_t taken = 0;  // bit s: sector s is included
  // To each side until the sheet ends, or all around.
  const auto gather = [&](std::uint32_t s, auto&& step) {
    Vec3 before = facet_normal(mesh, ring, place, s);
    for (; ring.has_sector(s) && (taken >> s & 1u) == 0; s = step(s)) {
      const Vec3 here = facet_normal(mesh, ring, place, s);
      if (!is_smooth(before, here)) return;
      sum += weighted_normal(mesh, ring, place, s);
      taken |= 1u << s;
      before = here;
    }
  };
  gather(left, [&ring](std::uint32_t s) { return ring.next(s); });
  gather(right, [&ring](std::uint32_t s) { return ring.previous(s); });
  const double size = sum.norm();
  return size > 0.0 ? Vec3(sum / size) : Vec3(Vec3::Zero());
}

/// The middle of the curve over the edge from a to its ring point k.
Vec3 middle_of(const LocalDelaunayMesh& mesh, std::uint32_t a, std::uint32_t k) {
  const std::uint32_t b = mesh.ring(a).of[k];
  return geometry::hermite_midpoint(mesh.at(a), mesh.at(b), normal_beside(mesh, a, k),
                                    normal_beside(mesh, b, mesh.ring(b).find(a)));
}

}  // namespace

/// Refines by one level.
class MeshRefiner {
 public:
  MeshRefiner(const LocalDelaunayMesh& mesh, int threads)
      : mesh_(mesh), threads_(threads), first_(mesh.size() + 1) {
    // An edge belongs to its lower place; new points are numbered after the old.
    for (std::uint32_t a = 0; a < mesh.size(); ++a) {
      std::uint32_t count = 0;
      const Ring ring = mesh.ring(a);
      for (std::uint32_t k = 0; k < ring.size; ++k) count += static_cast<std::uint32_t>(ring.of[k] > a);
      first_[a + 1] = first_[a] + count;
    }
  }

  LocalDelaunayMesh refine() {
    const std::uint32_t old = mesh_.size();
    cloud::Cloud cloud;
    cloud.origin_mm = mesh_.origin_mm();
    const std::size_t n = static_cast<std::size_t>(old) + first_.back();
    cloud.x_mm.resize(n);
    cloud.y_mm.resize(n);
    cloud.z_mm.resize(n);
    edge_.resize(first_.back());
    parallel_each(old, kPointsPerChunk, threads_, [&](std::size_t i) {
      const auto a = static_cast<std::uint32_t>(i);
      put(cloud, a, mesh_.at(a));
      const Ring ring = mesh_.ring(a);
      std::uint32_t number = first_[a];
      for (std::uint32_t k = 0; k < ring.size; ++k) {
        if (ring.of[k] <= a) continue;
        put(cloud, old + number, middle_of(mesh_, a, k));
        edge_[number++] = {a, k};
      }
    });
    const SortedPoints places = spatial_sort(cloud, threads_);
    const std::vector<std::uint32_t>& order = places.order;
    place_.resize(n);
    for (std::uint32_t place = 0; place < n; ++place) place_[order[place]] = place;

    LocalDelaunayMesh made;
    made.origin_mm_ = mesh_.origin_mm();
    made.counts_ = mesh_.counts();
    made.has_holes_ = mesh_.has_holes_;
    made.order_.resize(n);
    for (std::uint32_t place = 0; place < n; ++place)
      made.order_[place] = mesh_.order()[parent(order[place])];
    LocalDelaunayMeshStorage::fill(
        made, places.point, [&](std::uint32_t place) { return star_of(order[place]); },
        [&](std::uint32_t place) {
          const std::uint32_t from = parent(order[place]);
          return mesh_.is_closed(from) ? mesh_.closed_component(from) : kNoPlace;
        },
        [&](std::uint32_t place) {
          const std::uint32_t i = order[place];
          if (i < mesh_.size()) return mesh_.is_crossed(i);
          const auto [a, k] = edge_[i - mesh_.size()];
          return mesh_.is_crossed(a) || mesh_.is_crossed(mesh_.ring(a).of[k]);
        },
        threads_);
    made.counts_.unused -= made.counts_.welded;
    return made;
  }

 private:
  static void put(cloud::Cloud& cloud, std::size_t i, const Vec3& p) {
    cloud.x_mm[i] = static_cast<float>(p.x());
    cloud.y_mm[i] = static_cast<float>(p.y());
    cloud.z_mm[i] = static_cast<float>(p.z());
  }
  /// The old place, or the lower end of a new one's edge.
  [[nodiscard]] std::uint32_t parent(std::uint32_t i) const noexcept {
    return i < mesh_.size() ? i : edge_[i - mesh_.size()].place;
  }
  /// The new point between two old places that share an edge.
  [[nodiscard]] std::uint32_t between(std::uint32_t a, std::uint32_t b) const noexcept {
    if (a > b) std::swap(a, b);
    const Ring ring = mesh_.ring(a);
    std::uint32_t number = first_[a];
    for (std::uint32_t k = 0; ring.of[k] != b; ++k) number += static_cast<std::uint32_t>(ring.of[k] > a);
    return place_[mesh_.size() + number];
  }
  [[nodiscard]] Star star_of(std::uint32_t i) const noexcept {
    Star star;
    if (i < mesh_.size()) {
      const Ring ring = mesh_.ring(i);
      star.size = ring.size;
      star.open = ring.open;
      for (std::uint32_t k = 0; k < ring.size; ++k) star.ring[k] = between(i, ring.of[k]);
      return star;
    }
    // Counter-clockwise from b: the left triangle's two other middles, a, the right triangle's two.
    const auto [a, k] = edge_[i - mesh_.size()];
    const Ring ring = mesh_.ring(a);
    const std::uint32_t b = ring.of[k];
    const auto add = [&star](std::uint32_t place, bool open) {
      star.open |= static_cast<std::uint32_t>(open) << star.size;
      star.ring[star.size++] = place;
    };
    const bool left = ring.has_sector(k), right = ring.has_sector(ring.previous(k));
    add(place_[b], !left);
    if (left) {
      const std::uint32_t c = ring.of[ring.next(k)];
      add(between(b, c), false);
      add(between(c, a), false);
    }
    add(place_[a], !right);
    if (right) {
      const std::uint32_t d = ring.of[ring.previous(k)];
      add(between(a, d), false);
      add(between(d, b), false);
    }
    return star;
  }

  struct Edge {
    std::uint32_t place, k;
  };
  const LocalDelaunayMesh& mesh_;
  int threads_;
  std::vector<std::uint32_t> first_;  ///< per old place: the number of its first edge to a higher one
  std::vector<Edge> edge_;            ///< by number
  std::vector<std::uint32_t> place_;  ///< of old places, then of edges
};

LocalDelaunayMesh refined(LocalDelaunayMesh mesh, int levels, int threads) {
  for (int level = 0; level < levels; ++level) mesh = MeshRefiner(mesh, threads).refine();
  return mesh;
}

}  // namespace palpate::local_delaunay
