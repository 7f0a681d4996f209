// The points of a surface of stars, moving: the triangles stay, but where an edge is stretched it gets a
// point; the tree over the triangles follows.
#pragma once

#include <array>
#include <cstddef>
#include <vector>

#include "toolkit/core/hardware.h"
#include "toolkit/deformation/movable_points.h"
#include "toolkit/local_delaunay/deformable_mesh.h"
#include "toolkit/local_delaunay/mesh_descent.h"
#include "toolkit/render/surface_field.h"

namespace palpate::render {

class DeformedLocalDelaunay final : public MovablePoints {
 public:
  /// `mesh` is this renderer's own, still with its order(), and gets room for the spare points; `tree`
  /// becomes the tree over it; `surface` is what it is made of. All outlive this. Allocates.
  DeformedLocalDelaunay(local_delaunay::LocalDelaunayMesh& mesh, local_delaunay::BlockBvh& tree,
                        SurfaceField& surface, std::size_t spare_points, int threads);

  [[nodiscard]] const Vec3& origin_mm() const noexcept override { return stars_.mesh().origin_mm(); }
  [[nodiscard]] std::uint32_t place_of(std::uint32_t point) const noexcept override {
    return place_of_[point];
  }
  [[nodiscard]] Vec3 at(std::uint32_t place) const noexcept override { return stars_.mesh().at(place); }
  [[nodiscard]] Vec3 initial_position(std::uint32_t place) const noexcept override {
    return first_[place].at.cast<double>();
  }
  [[nodiscard]] double initial_resolution_mm(std::uint32_t place) const noexcept override {
    return static_cast<double>(first_[place].longest_mm);
  }
  [[nodiscard]] Vec3 area_normal(std::uint32_t place) const noexcept override {
    return local_delaunay::area_normal_around(stars_.mesh(), place);
  }
  [[nodiscard]] std::span<const std::uint32_t> links(std::uint32_t place) const noexcept override {
    const local_delaunay::Ring ring = stars_.mesh().ring(place);
    return {ring.of, ring.size};  // of points that move: in the mesh, not in `ring`
  }
  [[nodiscard]] std::uint32_t standing(std::uint32_t place, std::uint32_t below) const noexcept override {
    while (place >= below) place = stars_.parents(place)[0];
    return place;
  }

  void set(std::uint32_t place, const Vec3f& to) noexcept override { stars_.set(place, to); }
  void update_dependents(std::span<const MovedPoint> moved, UndoJournal& journal, DeformCounters& counters,
                         MoveWatcher& watcher) noexcept override;

  void reserve_records(std::size_t count) override { records_.resize(count); }
  void keep(std::size_t record, std::uint32_t place) noexcept override {
    records_[record] = at(place).cast<float>();
  }
  void put_back(std::size_t record, std::uint32_t place) noexcept override { set(place, records_[record]); }
  void restore_initial(std::uint32_t place) noexcept override {
    if (first_[place].at != Vec3f(at(place).cast<float>())) set(place, first_[place].at);
  }
  void remove_last(MoveWatcher& watcher) noexcept override;
  void finish_restoring() noexcept override { stars_.refit_all(); }

  [[nodiscard]] std::size_t bytes() const noexcept override;
  /// What bytes() will be, and by how much mesh and tree will grow.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points, std::size_t spare_points,
                                             std::size_t records) noexcept;

 private:
  /// What the surface around a place was when it was built.
  struct First {
    Vec3f at = Vec3f::Zero();
    float mean_mm = 0.0f, longest_mm = 0.0f;  ///< of the edges there
  };
  [[nodiscard]] bool stretched(std::uint32_t a, std::uint32_t b) const noexcept;
  bool infer_between(std::uint32_t a, std::uint32_t b, UndoJournal& journal, MoveWatcher& watcher) noexcept;

  local_delaunay::DeformableMesh stars_;
  SurfaceField* surface_;
  LargePageVector<std::uint32_t> place_of_;
  LargePageVector<First> first_;
  std::vector<Vec3f> records_;
};

}  // namespace palpate::render
