// The power crust (Amenta, Choi and Kolluri 2001). Balls about the poles (the farthest corners of each
// sample's Voronoi cell on either side) approximate the medial axis; faces of their power diagram between
// inner and outer balls are the surface. From the paper's description, on CGAL's triangulations.

#include <CGAL/Delaunay_triangulation_3.h>
#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Regular_triangulation_3.h>
#include <CGAL/Robust_weighted_circumcenter_filtered_traits_3.h>
#include <CGAL/Triangulation_cell_base_with_info_3.h>
#include <CGAL/Triangulation_vertex_base_with_info_3.h>
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <queue>

#include "baselines/reconstruct/method_functions.h"

namespace palpate::baselines {
namespace {

/// Links by starting pole, each in both directions.
struct Graph {
  struct To {
    std::uint32_t pole;
    float confidence;
    bool opposite;
  };
  std::vector<std::size_t> first;
  std::vector<To> to;

  Graph(std::size_t poles, std::span<const PoleLink> links) : first(poles + 1, 0), to(2 * links.size()) {
    for (const PoleLink& link : links) {
      ++first[link.a + 1];
      ++first[link.b + 1];
    }
    for (std::size_t i = 1; i < first.size(); ++i) first[i] += first[i - 1];
    std::vector<std::size_t> next(first.begin(), first.end() - 1);
    for (const PoleLink& link : links) {
      to[next[link.a]++] = {link.b, link.confidence, link.opposite};
      to[next[link.b]++] = {link.a, link.confidence, link.opposite};
    }
  }
};

struct Belief {
  float in = 0.0F, out = 0.0F;
  bool done = false;

  /// The paper's priority: one-sided beliefs by strength, contradictory ones last.
  [[nodiscard]] float priority() const noexcept {
    return in > 0.0F && out > 0.0F ? std::abs(in - out) - 1.0F : std::max(in, out);
  }
};

struct PoleEntry {
  float priority;
  std::uint32_t pole;
  bool operator<(const PoleEntry& other) const noexcept {
    return priority != other.priority ? priority < other.priority : pole > other.pole;
  }
};

}  // namespace

std::vector<bool> label_poles(std::size_t poles, std::span<const PoleLink> links,
                              std::span<const std::uint32_t> outside) {
  const Graph graph(poles, links);
  std::vector<Belief> beliefs(poles);
  std::priority_queue<PoleEntry> queue;
  for (const std::uint32_t pole : outside) {
    beliefs[pole].out = 1.0F;
    queue.push({1.0F, pole});
  }
  std::vector<bool> inside(poles, false);
  while (!queue.empty()) {
    const auto [priority, pole] = queue.top();
    queue.pop();
    Belief& own = beliefs[pole];
    // An entry is outdated once its belief has changed; a newer one exists then.
    if (own.done || priority != own.priority()) continue;
    own.done = true;
    inside[pole] = own.in > own.out;
    const float sure = std::max(own.in, own.out);
    for (std::size_t i = graph.first[pole]; i < graph.first[pole + 1]; ++i) {
      const Graph::To& link = graph.to[i];
      Belief& other = beliefs[link.pole];
      if (other.done) continue;
      float& belief = inside[pole] != link.opposite ? other.in : other.out;
      const float told = sure * link.confidence;
      if (told <= belief) continue;
      belief = told;
      queue.push({other.priority(), link.pole});
    }
  }
  return inside;
}

namespace {

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Robust = CGAL::Robust_weighted_circumcenter_filtered_traits_3<Kernel>;
using Point = Kernel::Point_3;

constexpr std::uint32_t kNone = 0xFFFFFFFFu;
constexpr std::uint32_t kCorner = 0xFFFFFFFEu;  ///< a corner of the box around all samples
/// Half the box in extents of the cloud: puts the outer poles on the outside's medial axis (the paper's "five
/// times larger").
constexpr double kBox = 2.5;
/// Corners nearer than this, in spacings, are merged. Rounding separates corners of nearly coincident poles
/// by up to 1e-6 spacings; true edges begin above 1e-4.
constexpr double kJoin = 0x1p-16;

using DelaunayStructure = CGAL::Triangulation_data_structure_3<
    CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel>,
    CGAL::Triangulation_cell_base_with_info_3<std::uint32_t, Kernel,
                                              CGAL::Delaunay_triangulation_cell_base_3<Kernel>>>;
using Delaunay = CGAL::Delaunay_triangulation_3<Kernel, DelaunayStructure>;
using PowerStructure = CGAL::Triangulation_data_structure_3<
    CGAL::Triangulation_vertex_base_with_info_3<std::uint32_t, Kernel,
                                                CGAL::Regular_triangulation_vertex_base_3<Kernel>>,
    CGAL::Triangulation_cell_base_with_info_3<std::uint32_t, Kernel,
                                              CGAL::Regular_triangulation_cell_base_3<Kernel>>>;
using Power = CGAL::Regular_triangulation_3<Kernel, PowerStructure>;

struct Poles {
  std::vector<Point> centre;
  std::vector<double> radius_sq;
  std::vector<PoleLink> links;
  std::vector<std::uint32_t> outside;
};

Delaunay voronoi(const MethodInput& input) {
  std::vector<std::pair<Point, std::uint32_t>> points;
  points.reserve(input.cloud.size() + 8);
  Vec3 low = Vec3::Zero(), high = Vec3::Zero();
  for (std::size_t i = 0; i < input.cloud.size(); ++i) {
    const Vec3 p = input.cloud.local_mm(i) / input.spacing;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
    points.emplace_back(Point(p.x(), p.y(), p.z()), static_cast<std::uint32_t>(i));
  }
  const Vec3 middle = 0.5 * (low + high);
  const double half = kBox * (high - low).maxCoeff();
  for (int corner = 0; corner < 8; ++corner)
    points.emplace_back(
        Point(middle.x() + (corner & 1 ? half : -half), middle.y() + (corner & 2 ? half : -half),
              middle.z() + (corner & 4 ? half : -half)),
        kCorner);
  Delaunay triangulation(points.begin(), points.end());
  for (auto cell = triangulation.all_cells_begin(); cell != triangulation.all_cells_end(); ++cell)
    cell->info() = kNone;
  return triangulation;
}

class PoleFinder {
 public:
  PoleFinder(const Delaunay& voronoi, Poles& poles) : voronoi_(voronoi), poles_(poles) {
    std::uint32_t next = 0;
    centres_.reserve(voronoi.number_of_finite_cells());
    for (auto cell = voronoi.finite_cells_begin(); cell != voronoi.finite_cells_end(); ++cell) {
      cell->info() = next++;
      const auto at = [&](int i) -> const Point& { return cell->vertex(i)->point(); };
      centres_.push_back(robust_.construct_circumcenter_3_object()(at(0), at(1), at(2), at(3)));
    }
    pole_of_.assign(centres_.size(), kNone);
  }

  void find() {
    for (auto vertex = voronoi_.finite_vertices_begin(); vertex != voronoi_.finite_vertices_end(); ++vertex)
      if (vertex->info() != kCorner) poles_of(vertex);
  }

 private:
  void poles_of(Delaunay::Vertex_handle sample) {
    cells_.clear();
    voronoi_.incident_cells(sample, std::back_inserter(cells_));
    const Point& s = sample->point();
    const Delaunay::Cell_handle far = farthest(s, [](const Kernel::Vector_3&) { return true; });
    if (far == Delaunay::Cell_handle()) return;
    const Kernel::Vector_3 up = centres_[far->info()] - s;
    const Delaunay::Cell_handle near = farthest(s, [&](const Kernel::Vector_3& v) { return v * up < 0.0; });
    const std::uint32_t a = pole(far, s);
    if (near == Delaunay::Cell_handle()) return;
    const std::uint32_t b = pole(near, s);
    const Kernel::Vector_3 down = centres_[near->info()] - s;
    const double cosine = up * down / std::sqrt(up.squared_length() * down.squared_length());
    if (cosine < 0.0) poles_.links.push_back({a, b, static_cast<float>(-cosine), true});
  }

  template <class Allowed>
  Delaunay::Cell_handle farthest(const Point& s, const Allowed& allowed) const {
    Delaunay::Cell_handle best;
    double best_sq = 0.0;
    for (const Delaunay::Cell_handle& cell : cells_) {
      if (voronoi_.is_infinite(cell)) continue;
      const Kernel::Vector_3 v = centres_[cell->info()] - s;
      if (v.squared_length() <= best_sq || !allowed(v)) continue;
      best = cell;
      best_sq = v.squared_length();
    }
    return best;
  }

  std::uint32_t pole(Delaunay::Cell_handle cell, const Point& s) {
    std::uint32_t& index = pole_of_[cell->info()];
    if (index != kNone) return index;
    index = static_cast<std::uint32_t>(poles_.centre.size());
    poles_.centre.push_back(centres_[cell->info()]);
    poles_.radius_sq.push_back(CGAL::squared_distance(poles_.centre.back(), s));
    for (int i = 0; i < 4; ++i)
      if (cell->vertex(i)->info() == kCorner) {
        poles_.outside.push_back(index);
        break;
      }
    return index;
  }

  const Robust robust_;
  const Delaunay& voronoi_;
  Poles& poles_;
  std::vector<Point> centres_;          // of the finite cells
  std::vector<std::uint32_t> pole_of_;  // of the finite cells
  std::vector<Delaunay::Cell_handle> cells_;
};

Power power_diagram(const Poles& poles) {
  std::vector<std::pair<Kernel::Weighted_point_3, std::uint32_t>> balls;
  balls.reserve(poles.centre.size());
  for (std::size_t i = 0; i < poles.centre.size(); ++i)
    balls.emplace_back(Kernel::Weighted_point_3(poles.centre[i], poles.radius_sq[i]),
                       static_cast<std::uint32_t>(i));
  return Power(balls.begin(), balls.end());
}

/// Deeply overlapping neighbours in the power diagram are on one side: their surfaces meet at an angle with
/// cosine near one (law of cosines).
void link_overlapping(const Power& power, Poles& poles) {
  for (auto edge = power.finite_edges_begin(); edge != power.finite_edges_end(); ++edge) {
    const std::uint32_t a = edge->first->vertex(edge->second)->info();
    const std::uint32_t b = edge->first->vertex(edge->third)->info();
    const double cosine =
        (poles.radius_sq[a] + poles.radius_sq[b] - CGAL::squared_distance(poles.centre[a], poles.centre[b])) /
        (2.0 * std::sqrt(poles.radius_sq[a] * poles.radius_sq[b]));
    if (cosine > 0.0) poles.links.push_back({a, b, static_cast<float>(std::min(cosine, 1.0)), false});
  }
}

/// The faces between inner and outer balls as consistently oriented fans of triangles.
class Faces {
 public:
  Faces(const Power& power, const MethodInput& input, geometry::TriangleMesh& mesh)
      : power_(power), input_(input), mesh_(mesh) {
    for (auto cell = power.all_cells_begin(); cell != power.all_cells_end(); ++cell) cell->info() = kNone;
  }

  void collect(const std::vector<bool>& inside) {
    for (auto edge = power_.finite_edges_begin(); edge != power_.finite_edges_end(); ++edge) {
      const auto a = edge->first->vertex(edge->second), b = edge->first->vertex(edge->third);
      if (inside[a->info()] == inside[b->info()]) continue;
      add(*edge, inside[a->info()]);
    }
  }
  [[nodiscard]] std::size_t open_faces() const noexcept { return open_faces_; }

 private:
  void add(const Power::Edge& edge, bool flipped) {
    corners_.clear();
    Power::Cell_circulator cell = power_.incident_cells(edge);
    const Power::Cell_circulator start = cell;
    do {
      if (power_.is_infinite(cell)) {
        ++open_faces_;
        return;
      }
      corners_.push_back(vertex(cell));
    } while (++cell != start);
    // Cells circle an edge in one direction from its first end, so two faces agree at a common edge;
    // make_mesh() finds the outside.
    if (flipped) std::reverse(corners_.begin(), corners_.end());
    for (std::size_t i = 2; i < corners_.size(); ++i)
      mesh_.triangles.push_back({corners_[0], corners_[i - 1], corners_[i]});
  }

  std::uint32_t vertex(Power::Cell_handle cell) {
    if (cell->info() == kNone) {
      cell->info() = static_cast<std::uint32_t>(mesh_.vertices_mm.size());
      const auto at = [&](int i) -> const Kernel::Weighted_point_3& { return cell->vertex(i)->point(); };
      const Point p = robust_.construct_weighted_circumcenter_3_object()(at(0), at(1), at(2), at(3));
      mesh_.vertices_mm.push_back(input_.cloud.origin_mm + Vec3(p.x(), p.y(), p.z()) * input_.spacing);
    }
    return cell->info();
  }

  const Robust robust_;
  const Power& power_;
  const MethodInput& input_;
  geometry::TriangleMesh& mesh_;
  std::vector<std::uint32_t> corners_;
  std::size_t open_faces_ = 0;
};

}  // namespace

Result<geometry::TriangleMesh> power_crust(const MethodInput& input, render::PreparePhases& phases) {
  Poles poles;
  phases.begin("Voronoi diagram");
  Delaunay samples = voronoi(input);
  phases.end();
  phases.begin("poles");
  PoleFinder(samples, poles).find();
  samples.clear();  // frees memory for the next one
  phases.end();
  phases.begin("power diagram");
  const Power power = power_diagram(poles);
  phases.end();
  phases.begin("inner and outer poles");
  link_overlapping(power, poles);
  const std::vector<bool> inside = label_poles(poles.centre.size(), poles.links, poles.outside);
  phases.end();
  phases.begin("faces");
  geometry::TriangleMesh mesh;
  Faces faces(power, input, mesh);
  faces.collect(inside);
  phases.end();
  phases.begin("joining corners");
  const WeldCounts joined = weld_vertices(mesh, kJoin * input.spacing);
  phases.end();
  phases.note(fmt::format("power crust: {} poles, {} of them inside", poles.centre.size(),
                          std::count(inside.begin(), inside.end(), true)));
  phases.note(fmt::format("power crust: {} corners joined that rounding held apart, {} triangles gone",
                          joined.vertices, joined.triangles));
  if (faces.open_faces() > 0)
    phases.note(fmt::format("power crust: {} faces without end left out", faces.open_faces()));
  return mesh;
}

}  // namespace palpate::baselines
