// A deforming mesh, with its tree. Its points move, and its stretched edges are split.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "toolkit/local_delaunay/block_bvh.h"
#include "toolkit/local_delaunay/local_delaunay_mesh.h"

namespace palpate::local_delaunay {

/// Most blocks refitted in a frame, 0.3 to 0.8 us each; the rest only grow until their turn. A full dent
/// changes about 80, as many moves all over a cloud up to 2,000.
inline constexpr std::size_t kMaxRefitBlocks = 256;

/// Belongs to one thread. Only the constructor allocates; no call throws. Work: set() visits the rings of one
/// ring, split() and undo_split() five rings, refit() kMaxRefitBlocks.
class DeformableMesh {
 public:
  /// Takes over `mesh`, with room for `spare` new points, and `tree`, which becomes the tree over it. Both
  /// outlive this.
  DeformableMesh(LocalDelaunayMesh& mesh, BlockBvh& tree, std::size_t spare, int threads);

  [[nodiscard]] const LocalDelaunayMesh& mesh() const noexcept { return *mesh_; }
  [[nodiscard]] std::uint32_t built() const noexcept { return built_; }
  [[nodiscard]] std::uint32_t used() const noexcept { return used_; }
  [[nodiscard]] std::uint32_t most() const noexcept { return mesh_->size(); }

  void set(std::uint32_t place, const Vec3f& to) noexcept;
  /// Adds a place in the middle of edge a b; the triangles on both sides become two each. kNoPlace without
  /// such an edge or without room.
  [[nodiscard]] std::uint32_t split(std::uint32_t a, std::uint32_t b) noexcept;
  /// Undoes the last remaining split(); every ring is restored exactly.
  void undo_split() noexcept;
  /// The ends of the edge that the place split.
  [[nodiscard]] const std::array<std::uint32_t, 2>& parents(std::uint32_t place) const noexcept {
    return parents_[place - built_];
  }
  /// Updates boxes and layers to the changes. Call it before any search.
  void refit() noexcept;
  /// The same with all boxes tight. O(changed).
  void refit_all() noexcept;
  /// Besides mesh and tree.
  [[nodiscard]] std::size_t bytes() const noexcept;
  /// The value of bytes() and the growth of mesh and tree, before building.
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
  /// Info word of a ring that is not long, in wide_.
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

  LocalDelaunayMesh* mesh_;
  BlockBvh* tree_;
  std::uint32_t built_, used_;
  std::vector<std::array<std::uint32_t, 2>> parents_;
  std::vector<std::uint32_t> free_rooms_;  ///< start of each long ring's room
  std::vector<std::uint32_t> changed_;     ///< ring buffer of blocks to refit, without repetition
  std::size_t first_changed_ = 0, changed_count_ = 0;
  std::vector<std::uint8_t> is_changed_;  ///< by block
};

}  // namespace palpate::local_delaunay
