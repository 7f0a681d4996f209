#include "baselines/rivals.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <palpate/result.h>
#include "baselines/mesh/surface_mesh.h"
#include "baselines/points/rival.h"
#include "baselines/renderers/facet_walk.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/render/prepare.h"
#include "toolkit/voronoi/voronoi.h"

namespace palpate::baselines {
namespace {

/// Most moves along the graph in a frame; the next frame continues. A HIP at 5 m/s moves 5 mm a frame, 50
/// vertices at 0.1 mm.
constexpr int kMaxGraphMoves = 256;
/// A HIP within so many rounding lengths of a triangle is not the start of a segment: its side is unsure.
constexpr double kUnsureRoundings = 16.0;

/// The links of the mesh's edges.
voronoi::Links mesh_links(const SurfaceMesh& mesh) {
  voronoi::Links links;
  const auto vertices = static_cast<std::uint32_t>(mesh.vertices().size());
  links.begin.push_back(0);
  std::vector<std::uint32_t> around;
  for (std::uint32_t v = 0; v < vertices; ++v) {
    around.clear();
    for (const std::uint32_t facet : mesh.star(v))
      for (const std::uint32_t corner : mesh.facet(facet).vertex)
        if (corner != v) around.push_back(corner);
    std::sort(around.begin(), around.end());
    around.erase(std::unique(around.begin(), around.end()), around.end());
    links.ends.insert(links.ends.end(), around.begin(), around.end());
    links.begin.push_back(static_cast<std::uint32_t>(links.ends.size()));
  }
  return links;
}

// Measured expectations, with the generator's own mesh: docs/results/rivals.md.
constexpr double kMsPerMillion = 36'000.0, kBytesPerFacet = 182.0;

class VGraph : public RivalModel {
 public:
  static constexpr RivalText kText{
      "vgraph", "triangles around the nearest vertex, found by a walk",
      "V-GRAPH [51] by the thesis's sections 2.2.3 and 3.6.3; response ours, after Zilles and Salisbury 1995",
      0.63, kMsPerMillion};
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs() {
    // The narrow phase looks at the triangles of the nearest vertex: it wants the Delaunay kind.
    std::vector<OptionSpec> specs = mesh_source_specs("advancing-front");
    specs.push_back(option::choice("triangles", "auto",
                                   "tested by the segment: those that share the nearest vertex, as printed, "
                                   "or also those that share one of theirs (ours; auto: where points are "
                                   "uneven, since of obtuse triangles the nearest vertex is often no corner)",
                                   {"auto", "vertex", "ring"}));
    specs.push_back(option::choice(
        "graph", "delaunay",
        "on which the walk goes: vertices whose Voronoi cells touch (it ends at the nearest), or mesh edges",
        {"delaunay", "mesh"}));
    return specs;
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    PALPATE_ASSIGN(decided_, decide_mesh(input, options));
    const Gaps gaps = measured_gaps(*input.cloud, context, report);
    const std::string& triangles = options.text("triangles");
    ring_ = triangles == "ring" || (triangles == "auto" && gaps.closing_mm() > gaps.spacing_mm);
    delaunay_ = options.text("graph") == "delaunay";
    const std::optional<double> made_ms = expected_ms(decided_, out.points);
    if (made_ms)
      *out.prepare_ms += *made_ms;
    else
      out.prepare_ms.reset();
    out.bytes += static_cast<std::uint64_t>(kBytesPerFacet * decided_.facets);
    out.decisions.push_back(decided_.explanation);
    out.decisions.push_back(
        delaunay_ ? render::Decision{"graph", "delaunay", "a greedy walk on it ends at the nearest vertex"}
                  : render::Decision{"graph", "mesh", "as given: the mesh's edges", true});
    out.decisions.push_back(
        ring_ ? render::Decision{"triangles", "ring", "those of the vertices around too", triangles == "ring"}
              : render::Decision{"triangles", "vertex", "those of the nearest vertex, as printed",
                                 triangles == "vertex"});
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    PALPATE_ASSIGN(source_, mesh_of(input, decided_, options, context.threads, phases));
    phases.begin("connect facets");
    PALPATE_ASSIGN(mesh_, SurfaceMesh::build(*source_, context.threads));
    phases.end();
    place = render::ModelPose(input, mesh_.origin_mm());
    if (delaunay_) {
      phases.begin("V-GRAPH (Delaunay, CGAL)");
      PALPATE_ASSIGN(links_, voronoi::natural_links(mesh_.vertices()));
    } else {
      phases.begin("V-GRAPH (mesh edges)");
      links_ = mesh_links(mesh_);
    }
    phases.end();
    unsure_mm_ = kUnsureRoundings * mesh_.rounding_mm();
    report.bytes += source_->bytes() + mesh_.bytes() + links_.bytes();
    report.notes.push_back(
        fmt::format("{:.2f} links a vertex",
                    static_cast<double>(links_.ends.size()) / static_cast<double>(mesh_.vertices().size())));
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "at most {} moves along the graph (unbounded in one respect: all neighbours of a vertex are looked "
        "at, as in the source; some 15 on a surface), the triangles of one vertex (or of its ring), and {} "
        "facets of the god object's walk",
        kMaxGraphMoves, kMaxFacetsPerFrame);
  }

  void restart(const Vec3& h) noexcept {
    // The vertex nearest to the HIP is found in O(n), so that the first frame need not walk across the model.
    double best = HUGE_VAL;
    const auto& vertices = mesh_.vertices();
    for (std::uint32_t v = 0; v < vertices.size(); ++v) {
      const double sq = (vertices[v] - h).squaredNorm();
      if (sq >= best || mesh_.star(v).empty()) continue;
      best = sq;
      vertex_ = v;
    }
    release_contact(h);
  }
  void release_contact(const Vec3& h) noexcept {
    previous_ = h;
    touching_ = false;
    at_ = {};
    state.release();
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    RivalAnswer answer;
    bool finished = walk_graph(h, counters);
    if (!touching_) look_for_entry(h);
    if (touching_) {
      const SlideCount slid = slide(mesh_, nullptr, h, at_);
      counters.walk_steps += slid.moves;
      finished = finished && slid.finished;
      if (outside(h)) {
        touching_ = false;
        if (at_.distance_sq > unsure_mm_ * unsure_mm_) previous_ = h;
      } else {
        answer = {true, false, at_.point - h, Vec3::Zero()};
      }
    }
    answer.bound_hit = !finished;
    return answer;
  }

 private:
  /// Broad phase. False at the bound.
  bool walk_graph(const Vec3& h, render::FrameCounters& counters) noexcept {
    const auto& vertices = mesh_.vertices();
    double best = (vertices[vertex_] - h).squaredNorm();
    for (int move = 0; move < kMaxGraphMoves; ++move) {
      const std::uint32_t from = vertex_;
      for (const std::uint32_t other : links_.of(from)) {
        const double sq = (vertices[other] - h).squaredNorm();
        if (sq >= best) continue;
        best = sq;
        vertex_ = other;
      }
      if (vertex_ == from) return true;
      ++counters.walk_steps;
    }
    return false;
  }
  /// The share of the segment at which it enters, and whether the HIP is clear of all triangles tested.
  struct Entry {
    double at = 2.0;
    bool sure = true;
  };
  /// Narrow phase: the HIP's segment against the triangles that share the vertex.
  void look_for_entry(const Vec3& h) noexcept {
    Entry entry;
    test_star(vertex_, h, entry);
    if (ring_)
      for (const std::uint32_t number : mesh_.star(vertex_))
        for (const std::uint32_t corner : mesh_.facet(number).vertex)
          if (corner != vertex_) test_star(corner, h, entry);
    touching_ = entry.at <= 1.0;
    if (!touching_ && entry.sure) previous_ = h;
  }
  void test_star(std::uint32_t vertex, const Vec3& h, Entry& entry) noexcept {
    for (const std::uint32_t number : mesh_.star(vertex)) {
      const Facet& facet = mesh_.facet(number);
      entry.sure = entry.sure && closest_on_facet(facet, h).distance_sq > unsure_mm_ * unsure_mm_;
      const Vec3 normal = mesh_.normal(half_facet(number, 0));
      const double before = normal.dot(previous_ - facet.corner[0]), behind = normal.dot(h - facet.corner[0]);
      if ((before > 0.0) == (behind > 0.0) || before == behind) continue;
      const double t = before / (before - behind);
      if (!(t >= 0.0 && t < entry.at)) continue;
      const FacetPoint on = closest_on_facet(facet, previous_ + (h - previous_) * t);
      if (on.distance_sq > unsure_mm_ * unsure_mm_) continue;
      entry.at = t;
      at_ = {half_facet(number, before > 0.0 ? 0u : 1u), on.feature, on.point, on.distance_sq};
    }
  }
  /// True if the HIP is in front of the feature that the god object rests on, or past a rim by more than an
  /// edge, as mesh-godobject decides it.
  [[nodiscard]] bool outside(const Vec3& h) const noexcept {
    bool boundary = false;
    const Vec3 away = mesh_.pseudonormal(at_.half, at_.feature, &boundary);
    const Vec3 r = h - at_.point;
    const double height = away.dot(r);
    return height > 0.0 ||
           (boundary && r.squaredNorm() - height * height > mesh_.longest_edge_sq(facet_of(at_.half)));
  }

  std::shared_ptr<const geometry::TriangleMesh> source_;
  SurfaceMesh mesh_;
  voronoi::Links links_;
  bool ring_ = false;
  bool delaunay_ = true;  ///< this and the next: for preparation
  MeshSource decided_;
  double unsure_mm_ = 0.0;
  std::uint32_t vertex_ = 0;      ///< nearest to the HIP, as far as the walk came
  Vec3 previous_ = Vec3::Zero();  ///< start of the next segment: the last HIP whose side was sure
  bool touching_ = false;
  SurfacePosition at_;
};

}  // namespace

render::RendererInfo vgraph_info() {
  return rival_info<VGraph>();
}

}  // namespace palpate::baselines
