// A star mesh whose points move and whose edges are split where they are stretched, with the tree over it:
// what a surface that gives way has of its own.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/stars/star_mesh.h"
#include "toolkit/stars/star_tree.h"

namespace palpate::stars {

/// Blocks whose boxes a frame makes anew, 0.3 to 0.8 us each; of more, the rest only grow and are made anew
/// when their turn comes. A full dent changes some 80, as many moves all over a cloud up to 2,000.
inline constexpr std::size_t kMaxRefitBlocks = 256;

/// Belongs to one thread. Only the constructor allocates; no call throws. Work: of set() the rings of one
/// ring, of split() and join_last() five rings, of refit() kMaxRefitBlocks.
class MovingStars {
 public:
  /// `mesh` is this one's own to change, with room for `spare` points to come; `tree` becomes the tree over
  /// it. Both outlive this.
  MovingStars(StarMesh& mesh, StarTree& tree, std::size_t spare, int threads);

  [[nodiscard]] const StarMesh& mesh() const noexcept { return *mesh_; }
  [[nodiscard]] std::uint32_t built() const noexcept { return built_; }
  [[nodiscard]] std::uint32_t used() const noexcept { return used_; }
  [[nodiscard]] std::uint32_t most() const noexcept { return mesh_->size(); }

  void set(std::uint32_t place, const Vec3f& to) noexcept;
  /// A new place in the middle of the edge from a to b: the triangles on both sides become two each. kNoPlace
  /// where there is no such edge, or no room.
  [[nodiscard]] std::uint32_t split(std::uint32_t a, std::uint32_t b) noexcept;
  /// Takes back the last split() that is left: every ring is what it was, to the bit.
  void join_last() noexcept;
  /// The ends of the edge that a place came from.
  [[nodiscard]] const std::array<std::uint32_t, 2>& parents(std::uint32_t place) const noexcept {
    return parents_[place - built_];
  }
  /// Boxes and layers hold what was changed since the last time. Nothing may be looked for before.
  void refit() noexcept;
  /// The same, and none is larger than it has to be. O(changed).
  void refit_all() noexcept;
  /// Beside mesh and tree.
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// What bytes() will be, and by how much the mesh and its tree will grow.
  [[nodiscard]] static std::size_t bytes_for(std::size_t points, std::size_t spare) noexcept;

 private:
  /// A ring to be changed.
  struct Row {
    std::uint32_t* of;
    std::uint32_t size, open;
  };
  [[nodiscard]] Row row(std::uint32_t place) noexcept;
  void set_size(std::uint32_t place, std::uint32_t size, std::uint32_t open) noexcept;
  [[nodiscard]] bool is_long(std::uint32_t place) const noexcept;
  /// Of a ring that is not long: in wide_.
  [[nodiscard]] static std::uint32_t short_info(std::uint32_t size, std::uint32_t open) noexcept;
  [[nodiscard]] bool can_insert(std::uint32_t place, std::size_t& rooms) const noexcept;
  void replace(std::uint32_t place, std::uint32_t old, std::uint32_t by) noexcept;
  void insert_after(std::uint32_t place, std::uint32_t before, std::uint32_t added) noexcept;
  void erase(std::uint32_t place, std::uint32_t gone) noexcept;
  void lengthen(std::uint32_t place) noexcept;
  void shorten(std::uint32_t place) noexcept;
  template <class Use>
  void for_blocks_of(std::uint32_t place, Use&& use) const noexcept;
  void mark(std::uint32_t place) noexcept;
  void grow_star(std::uint32_t place) noexcept;
  void mark_block(std::uint32_t block) noexcept;

  StarMesh* mesh_;
  StarTree* tree_;
  std::uint32_t built_, used_;
  std::vector<std::array<std::uint32_t, 2>> parents_;
  std::vector<std::uint32_t> free_rooms_;  ///< for long rings: where each begins
  std::vector<std::uint32_t> changed_;     ///< a ring: blocks to be made anew, each once
  std::size_t first_changed_ = 0, changed_count_ = 0;
  std::vector<std::uint8_t> is_changed_;  ///< by block
};

}  // namespace palpate::stars
