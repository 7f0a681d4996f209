#include "baselines/points/vgraph.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "baselines/mesh/surface_mesh.h"
#include "baselines/points/gaps.h"
#include "baselines/points/rival.h"
#include "baselines/renderers/facet_walk.h"
#include "baselines/renderers/mesh_source.h"
#include "toolkit/render/prepare_phases.h"
#include "toolkit/voronoi/voronoi.h"

namespace palpate::baselines {
namespace {

/// Moves along the graph in a frame, at most; the walk goes on in the next. A HIP at 5 m/s moves 5 mm a
/// frame, 50 vertices at 0.1 mm.
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

// Measured, what to expect: docs/rivals.md, with the generator's own mesh.
constexpr double kMsPerMillion = 36'000.0, kBytesPerFacet = 182.0;

class VGraph : public RivalModel {
 public:
  static constexpr RivalText kText{
      "vgraph", "greedy walk on a graph of vertices, then the triangles around the nearest",
      "V-GRAPH [51] by the thesis's sections 2.2.3 and 3.6.3; response ours, after Zilles and Salisbury "
      "1995",
      0.63, kMsPerMillion};
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs();
  static Status decide(VGraph& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report,
                       render::ModelDecisions& out);
  static Status prepare(VGraph& model, const render::ModelInput& input, const Options& options,
                        const render::PrepareContext& context, render::PrepareReport& report);
  [[nodiscard]] std::string work_bound() const;

  void restart(const Vec3& h) noexcept;
  void let_go(const Vec3& h) noexcept;
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept;

 private:
  bool walk_graph(const Vec3& h, render::FrameCounters& counters) noexcept;
  /// Where the segment enters, as a share of it, and whether the HIP is clear of all triangles tested.
  struct Entry {
    double at = 2.0;
    bool sure = true;
  };
  void look_for_entry(const Vec3& h) noexcept;
  void test_star(std::uint32_t vertex, const Vec3& h, Entry& entry) noexcept;
  [[nodiscard]] bool outside(const Vec3& h) const noexcept;

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

std::vector<OptionSpec> VGraph::specs() {
  // The narrow phase looks at the triangles of the nearest vertex: it wants the Delaunay kind.
  std::vector<OptionSpec> specs = mesh_source_specs("advancing-front");
  specs.push_back(
      {"triangles",
       OptionKind::kChoice,
       "auto",
       "tested by the segment: those that share the nearest vertex, as printed, or also those that "
       "share one of theirs (ours; auto: where points are uneven, since of obtuse triangles the nearest "
       "vertex is often no corner)",
       {"auto", "vertex", "ring"}});
  specs.push_back(
      {"graph",
       OptionKind::kChoice,
       "delaunay",
       "on which the walk goes: vertices whose Voronoi cells touch (it ends at the nearest), or mesh edges",
       {"delaunay", "mesh"}});
  return specs;
}

Status VGraph::decide(VGraph& model, const render::ModelInput& input, const Options& options,
                      const render::PrepareContext& context, render::PrepareReport& report,
                      render::ModelDecisions& out) {
  Result<MeshSource> source = decide_mesh(input, options);
  if (!source.ok()) return std::move(source).error();
  model.decided_ = std::move(source).value();
  const Gaps gaps = measured_gaps(*input.cloud, context, report);
  const std::string& triangles = options.text("triangles");
  model.ring_ = triangles == "ring" || (triangles == "auto" && gaps.closing_mm() > gaps.spacing_mm);
  model.delaunay_ = options.text("graph") == "delaunay";
  const std::optional<double> made_ms = expected_ms(model.decided_, out.points);
  if (made_ms)
    *out.prepare_ms += *made_ms;
  else
    out.prepare_ms.reset();
  out.bytes += static_cast<std::uint64_t>(kBytesPerFacet * model.decided_.facets);
  out.decisions.push_back(model.decided_.said);
  out.decisions.push_back(
      model.delaunay_
          ? render::Decision{"graph", "delaunay", "a greedy walk on it ends at the nearest vertex"}
          : render::Decision{"graph", "mesh", "as given: the mesh's edges", true});
  out.decisions.push_back(
      model.ring_
          ? render::Decision{"triangles", "ring", "those of the vertices around too", triangles == "ring"}
          : render::Decision{"triangles", "vertex", "those of the nearest vertex, as printed",
                             triangles == "vertex"});
  return Done{};
}

Status VGraph::prepare(VGraph& model, const render::ModelInput& input, const Options& options,
                       const render::PrepareContext& context, render::PrepareReport& report) {
  render::PreparePhases phases(report, context);
  auto source = mesh_of(input, model.decided_, options, context.threads, phases);
  if (!source.ok()) return std::move(source).error();
  model.source_ = std::move(source).value();
  phases.begin("connect facets");
  auto mesh = SurfaceMesh::build(*model.source_, context.threads);
  if (!mesh.ok()) return std::move(mesh).error();
  model.mesh_ = std::move(mesh).value();
  phases.end();
  model.place = render::ModelPose(input, model.mesh_.origin_mm());
  if (model.delaunay_) {
    phases.begin("V-GRAPH (Delaunay, CGAL)");
    auto links = voronoi::natural_links(model.mesh_.vertices());
    if (!links.ok()) return std::move(links).error();
    model.links_ = std::move(links).value();
  } else {
    phases.begin("V-GRAPH (mesh edges)");
    model.links_ = mesh_links(model.mesh_);
  }
  phases.end();
  model.unsure_mm_ = kUnsureRoundings * model.mesh_.rounding_mm();
  report.bytes += model.source_->bytes() + model.mesh_.bytes() + model.links_.bytes();
  report.notes.push_back(fmt::format(
      "{:.2f} links a vertex",
      static_cast<double>(model.links_.ends.size()) / static_cast<double>(model.mesh_.vertices().size())));
  return Done{};
}

std::string VGraph::work_bound() const {
  return fmt::format(
      "at most {} moves along the graph (unbounded in one respect: all neighbours of a vertex are looked at, "
      "as in "
      "the source; some 15 on a surface), the triangles of one vertex (or of its ring), and {} facets of the "
      "god object's "
      "walk",
      kMaxGraphMoves, kMaxFacetsPerFrame);
}

void VGraph::restart(const Vec3& h) noexcept {
  // Of the vertex nearest to the HIP: O(n), so that the first frame need not walk across the model.
  double best = HUGE_VAL;
  const auto& vertices = mesh_.vertices();
  for (std::uint32_t v = 0; v < vertices.size(); ++v) {
    const double sq = (vertices[v] - h).squaredNorm();
    if (sq >= best || mesh_.star(v).empty()) continue;
    best = sq;
    vertex_ = v;
  }
  let_go(h);
}

void VGraph::let_go(const Vec3& h) noexcept {
  previous_ = h;
  touching_ = false;
  at_ = {};
  state.release();
}

/// Broad phase. Returns false where the bound was hit.
bool VGraph::walk_graph(const Vec3& h, render::FrameCounters& counters) noexcept {
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

/// Narrow phase: the HIP's segment against the triangles that share the vertex.
void VGraph::look_for_entry(const Vec3& h) noexcept {
  Entry entry;
  test_star(vertex_, h, entry);
  if (ring_)
    for (const std::uint32_t number : mesh_.star(vertex_))
      for (const std::uint32_t corner : mesh_.facet(number).vertex)
        if (corner != vertex_) test_star(corner, h, entry);
  touching_ = entry.at <= 1.0;
  if (!touching_ && entry.sure) previous_ = h;
}

void VGraph::test_star(std::uint32_t vertex, const Vec3& h, Entry& entry) noexcept {
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

/// As mesh-godobject decides it: in front of the feature it rests on, or past a rim by more than an edge.
bool VGraph::outside(const Vec3& h) const noexcept {
  bool boundary = false;
  const Vec3 away = mesh_.pseudonormal(at_.half, at_.feature, &boundary);
  const Vec3 r = h - at_.point;
  const double height = away.dot(r);
  return height > 0.0 ||
         (boundary && r.squaredNorm() - height * height > mesh_.longest_edge_sq(facet_of(at_.half)));
}

RivalAnswer VGraph::update(const Vec3& h, render::FrameCounters& counters) noexcept {
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

}  // namespace

render::RendererInfo vgraph_info() {
  return rival_info<VGraph>();
}

}  // namespace palpate::baselines
