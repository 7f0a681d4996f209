// The points of the vertices' surface, moving: the partition, the links and the planes follow.
#pragma once

#include <cstddef>
#include <vector>

#include "toolkit/deformation/movable_points.h"
#include "toolkit/points/point_model.h"
#include "toolkit/points/point_walk.h"

namespace palpate::render {

class MovingVertices final : public MovablePoints {
 public:
  /// `model` was built with PointModelOptions::moving and as many spare points, `surface` is what it is made
  /// of; both outlive this. Copies the points, 48 bytes each, for reset(). Allocates.
  MovingVertices(PointModel& model, SurfaceField& surface, std::size_t spare_points);

  [[nodiscard]] const Vec3& origin_mm() const noexcept override { return model_->origin_mm; }
  [[nodiscard]] std::uint32_t place_of(std::uint32_t point) const noexcept override {
    return model_->place_of[point];
  }
  [[nodiscard]] Vec3 at(std::uint32_t place) const noexcept override { return model_->points[place].at(); }
  [[nodiscard]] Vec3 first_at(std::uint32_t place) const noexcept override {
    return first_points_[standing(place, built_)].at();
  }
  [[nodiscard]] double first_resolution_mm(std::uint32_t place) const noexcept override;
  [[nodiscard]] Vec3 area_normal(std::uint32_t place) const noexcept override {
    const surface::NormalCode code = model_->points[place].normal;
    if (code == surface::kNoNormal) return Vec3::Zero();
    return distance_sq(model_->points[model_->neighbours[place][0]], at(place)) *
           surface::decode_normal(code);
  }
  [[nodiscard]] std::span<const std::uint32_t> links(std::uint32_t place) const noexcept override {
    return model_->neighbours[place];
  }
  /// An inferred point is linked to its parents or their neighbours, which all came before it.
  [[nodiscard]] std::uint32_t standing(std::uint32_t place, std::uint32_t below) const noexcept override;

  [[nodiscard]] bool make_room(std::uint32_t place, const Vec3f& to) noexcept override;
  void set(std::uint32_t place, const Vec3f& to) noexcept override;
  void settle(std::span<const MovedPoint> moved, Journal& journal, DeformCounters& counters,
              MoveWatcher& watcher) noexcept override;

  void allow_records(std::size_t count) override { records_.resize(count); }
  void keep(std::size_t record, std::uint32_t place) noexcept override {
    records_[record] = {model_->points[place], model_->neighbours[place]};
  }
  [[nodiscard]] bool put_back(std::size_t record, std::uint32_t place) noexcept override {
    return put_back(place, records_[record].point, records_[record].links);
  }
  [[nodiscard]] bool put_back_first(std::uint32_t place) noexcept override {
    return put_back(place, first_points_[place], first_links_[place]);
  }
  void remove_last(MoveWatcher& watcher) noexcept override;
  void finish_putting_back() noexcept override {}

  [[nodiscard]] std::size_t bytes() const noexcept override;
  /// What bytes() will be for so many points and records.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points, std::size_t records) noexcept {
    return (points + records) * sizeof(Record);
  }

 private:
  struct Record {
    StoredPoint point;
    neighbourhood::Neighbours links;
  };
  [[nodiscard]] bool put_back(std::uint32_t place, const StoredPoint& point,
                              const neighbourhood::Neighbours& links) noexcept;
  void mend_stretched(std::span<const MovedPoint> moved, Journal& journal, DeformCounters& counters) noexcept;
  bool infer_between(std::uint32_t a, std::uint32_t b, Journal& journal) noexcept;
  void link_new(std::uint32_t place, std::uint32_t a, std::uint32_t b, Journal& journal) noexcept;
  [[nodiscard]] bool apart(std::uint32_t a, std::uint32_t b) const noexcept;

  PointModel* model_;
  SurfaceField* surface_;
  LargeVector<StoredPoint> first_points_;
  LargeVector<neighbourhood::Neighbours> first_links_;
  std::vector<Record> records_;
};

}  // namespace palpate::render
