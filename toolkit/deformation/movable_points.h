// What a deformer changes: points in places that are linked to each other, with room for more, and whatever
// follows them; and what places were like before, stroke by stroke, so that strokes can be taken back.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

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

/// Belongs to one deformer. Only the constructor allocates.
class UndoJournal {
 public:
  struct Entry {
    std::uint32_t place;
    bool existed;
  };

  /// Room for `entries`; where they are used up the oldest strokes are forgotten. The records are the
  /// points'.
  UndoJournal(MovablePoints& points, std::size_t entries) : points_(&points), entries_(entries) {
    points.reserve_records(entries);
    recorded_.resize(points.most());
  }

  /// What is changed from now on is undone together.
  void begin_stroke() noexcept {
    ++stroke_number_;
    // An empty stroke is used again.
    if (next_stroke_ > first_stroke_ && strokes_[(next_stroke_ - 1) % kMaxStrokes] == next_entry_) return;
    if (next_stroke_ - first_stroke_ == kMaxStrokes) forget_oldest();
    strokes_[next_stroke_++ % kMaxStrokes] = next_entry_;
  }
  /// Before a place is changed, or when one has come that did not exist: what it was like before the stroke,
  /// once.
  void remember(std::uint32_t place, bool existed) noexcept {
    if (recorded_[place] == stroke_number_) return;
    recorded_[place] = stroke_number_;
    if (entries_.empty()) return;
    // The ring is full: the strokes whose first entries would be written over are forgotten.
    while (first_stroke_ < next_stroke_ &&
           next_entry_ - strokes_[first_stroke_ % kMaxStrokes] >= entries_.size())
      forget_oldest();
    const std::size_t at = next_entry_++ % entries_.size();
    entries_[at] = {place, existed};
    if (existed) points_->keep(at, place);
  }
  /// restore(entry, its record) for the last stroke that is remembered, the last change first. False where
  /// there is none.
  template <class Restore>
  bool undo_last_stroke(Restore&& restore) noexcept {
    if (first_stroke_ == next_stroke_) return false;
    // The stroke that is open may be empty: then the one before is meant.
    if (strokes_[(next_stroke_ - 1) % kMaxStrokes] == next_entry_) {
      if (next_stroke_ - 1 == first_stroke_) return false;
      --next_stroke_;
    }
    const std::size_t begin = strokes_[(next_stroke_ - 1) % kMaxStrokes];
    while (next_entry_ > begin) {
      const std::size_t at = --next_entry_ % entries_.size();
      restore(entries_[at], at);
    }
    --next_stroke_;
    begin_stroke();
    return true;
  }
  void forget_all() noexcept {
    first_stroke_ = next_stroke_ = 0;
    next_entry_ = 0;
    begin_stroke();
  }
  [[nodiscard]] std::uint64_t forgotten() const noexcept { return forgotten_; }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return entries_.capacity() * sizeof(Entry) + recorded_.capacity() * sizeof(std::uint64_t);
  }
  [[nodiscard]] static std::size_t bytes_for(std::size_t places, std::size_t entries) noexcept {
    return entries * sizeof(Entry) + places * sizeof(std::uint64_t);
  }

 private:
  static constexpr std::size_t kMaxStrokes = 64;
  void forget_oldest() noexcept {
    ++first_stroke_;
    ++forgotten_;
  }

  MovablePoints* points_;
  std::vector<Entry> entries_;                      ///< a ring
  std::size_t next_entry_ = 0;                      ///< ever rising
  std::array<std::size_t, kMaxStrokes> strokes_{};  ///< a ring: the first entry of each
  std::size_t first_stroke_ = 0, next_stroke_ = 0;
  std::vector<std::uint64_t> recorded_;  ///< by place: the stroke that recorded it last
  std::uint64_t stroke_number_ = 0;
  std::uint64_t forgotten_ = 0;
};

}  // namespace palpate::render
