// What a deformer changes: points in places that are linked to each other, with room for more, and whatever
// follows them.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include <palpate/vec.h>

namespace palpate::render {

class UndoJournal;

/// Points one call may infer; stretched links beyond it are mended when they are moved again.
inline constexpr std::size_t kMaxInferredPoints = 8;

struct DeformCounters {
  std::uint64_t moved = 0;         ///< points moved
  std::uint64_t inferred = 0;      ///< points added where the surface was stretched
  std::uint64_t refused = 0;       ///< moves to no finite place: the point stayed
  std::uint64_t not_inferred = 0;  ///< stretched links left for want of spare points
  std::uint64_t forgotten = 0;     ///< strokes that can no more be undone
};

struct MovedPoint {
  std::uint32_t place;
  Vec3 from_mm, to_mm;
};

/// Is told of every point that goes from one place to another, as soon as it has gone.
class MoveWatcher {
 public:
  virtual void point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept = 0;

 protected:
  ~MoveWatcher() = default;
};

/// told(place, from, to) as a watcher.
template <class Told>
class CallbackWatcher final : public MoveWatcher {
 public:
  explicit CallbackWatcher(Told told) : told_(told) {}
  void point_moved(std::uint32_t place, const Vec3& from, const Vec3& to) noexcept override {
    told_(place, from, to);
  }

 private:
  Told told_;
};

/// Local coordinates, mm. Places below built() are the cloud's points, those from there to used() were
/// inferred since, and go again in the opposite order. Nothing allocates but reserve_records(); no call
/// throws.
class MovablePoints {
 public:
  MovablePoints() = default;
  MovablePoints(const MovablePoints&) = delete;
  MovablePoints& operator=(const MovablePoints&) = delete;
  virtual ~MovablePoints() = default;

  [[nodiscard]] std::uint32_t built() const noexcept { return built_; }
  [[nodiscard]] std::uint32_t used() const noexcept { return used_; }
  /// Places there can be.
  [[nodiscard]] std::uint32_t most() const noexcept { return most_; }
  [[nodiscard]] virtual const Vec3& origin_mm() const noexcept = 0;
  [[nodiscard]] virtual std::uint32_t place_of(std::uint32_t point) const noexcept = 0;
  [[nodiscard]] virtual Vec3 at(std::uint32_t place) const noexcept = 0;
  /// Where the surface there was when it was built.
  [[nodiscard]] virtual Vec3 initial_position(std::uint32_t place) const noexcept = 0;
  /// How far apart points were there then: to the farthest of those around.
  [[nodiscard]] virtual double initial_resolution_mm(std::uint32_t place) const noexcept = 0;
  /// The surface's normal there, as long as the area that is the point's.
  [[nodiscard]] virtual Vec3 area_normal(std::uint32_t place) const noexcept = 0;
  [[nodiscard]] virtual std::span<const std::uint32_t> links(std::uint32_t place) const noexcept = 0;
  /// A place itself where it is below `below`, or one that it was inferred from.
  [[nodiscard]] virtual std::uint32_t standing(std::uint32_t place, std::uint32_t below) const noexcept = 0;

  virtual void set(std::uint32_t place, const Vec3f& to) noexcept = 0;
  /// What follows the points that were moved: boxes, and new points where the surface is stretched.
  virtual void update_dependents(std::span<const MovedPoint> moved, UndoJournal& journal,
                                 DeformCounters& counters, MoveWatcher& watcher) noexcept = 0;

  /// Room for so many records.
  virtual void reserve_records(std::size_t count) = 0;
  /// Keeps in a record what a place is like.
  virtual void keep(std::size_t record, std::uint32_t place) noexcept = 0;
  /// The place is as the record says.
  virtual void put_back(std::size_t record, std::uint32_t place) noexcept = 0;
  /// The same, as it was built; no point is inferred any more.
  virtual void restore_initial(std::uint32_t place) noexcept = 0;
  /// The last inferred point goes.
  virtual void remove_last(MoveWatcher& watcher) noexcept = 0;
  /// Everything is back that was to go back.
  virtual void finish_restoring() noexcept = 0;
  [[nodiscard]] virtual std::size_t bytes() const noexcept = 0;

 protected:
  std::uint32_t built_ = 0, used_ = 0, most_ = 0;
};

}  // namespace palpate::render
