// Connected pieces of a mesh, with their sides. Facet sides agree within a piece, which is touched from one
// side or both.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// A piece: facets connected over edges shared by exactly two. A single consistent piece needs no memory.
struct Pieces {
  std::size_t count = 0;
  std::vector<std::uint32_t> number;  ///< piece of every facet, ordered by first facet; empty: one piece
  std::vector<std::uint8_t> flipped;  ///< 1: opposite to the piece's first facet; empty: none

  [[nodiscard]] std::uint32_t piece_of(std::uint32_t facet) const noexcept {
    return number.empty() ? 0u : number[facet];
  }
  /// The facet's side that agrees with side 0 of its piece's first facet.
  [[nodiscard]] std::uint32_t side(std::uint32_t facet) const noexcept {
    return flipped.empty() ? 0u : flipped[facet];
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return number.capacity() * sizeof(std::uint32_t) + flipped.capacity();
  }
};

/// A piece ends at edges of more than two facets, whose pairing is unknown. A non-orientable piece (Moebius
/// strip) disagrees somewhere. O(facets), parallel, the same for any `threads`.
[[nodiscard]] Pieces pieces_of(const SurfaceMesh& mesh, int threads);

/// The same, but a piece continues over edges of more than two facets: a repair tries this and cuts where it
/// fails. O(facets).
[[nodiscard]] Pieces pieces_across_many(const SurfaceMesh& mesh);

/// Component number of every facet, connected over edges of any number of facets, ordered by first facet.
/// O(facets).
[[nodiscard]] std::vector<std::uint32_t> components_of(const SurfaceMesh& mesh);

/// Pieces of a mesh and which of them enclose a volume. Immutable; concurrent reads are safe.
struct PieceOrientation {
  struct Piece {
    bool closed = false;
    std::uint32_t outer = 0;  ///< outward side of its first facet
  };
  Pieces pieces;
  std::vector<Piece> each;
  bool any_closed = false;

  /// Of a mesh known to be open, with facets that agree.
  [[nodiscard]] static PieceOrientation open_sheet() { return {{1, {}, {}}, {Piece{}}, false}; }
  /// O(facets), parallel, independent of the number of threads.
  [[nodiscard]] static PieceOrientation of(const SurfaceMesh& mesh, int threads);
  [[nodiscard]] std::size_t bytes() const noexcept {
    return pieces.bytes() + each.capacity() * sizeof(Piece);
  }
};

/// A piece that encloses a volume is touched only from the side where the HIP began, any other from both.
/// Sides agree with the piece's first facet, whatever the facets' orientation. Mesh and sides must outlive
/// this object. For one thread.
class FreeSide {
 public:
  FreeSide(const SurfaceMesh& mesh, const PieceOrientation& sides);
  /// The HIP is free at `hip` (local, mm). O(facets) if a piece encloses a volume. No allocation.
  void begin_at(const Vec3& hip) noexcept;
  [[nodiscard]] bool touches(HalfFacet half) const noexcept {
    const std::uint32_t piece = sides_->pieces.piece_of(facet_of(half));
    return !sides_->each[piece].closed ||
           (side_of(half) ^ sides_->pieces.side(facet_of(half))) == here_[piece].front;
  }

 private:
  struct Here {
    std::uint32_t front = 0;  ///< touched side of its first facet
    double angle = 0.0;       ///< solid angle from the HIP
  };
  const SurfaceMesh* mesh_;
  const PieceOrientation* sides_;
  std::vector<Here> here_;
};

}  // namespace palpate::baselines
