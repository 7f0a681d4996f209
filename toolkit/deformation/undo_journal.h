// What places were like before they were changed, stroke by stroke, so that strokes can be taken back.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/deformation/movable_points.h"

namespace palpate::render {

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
