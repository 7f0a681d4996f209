// From which side the pieces of a mesh are touched.
#pragma once

#include <cstdint>
#include <vector>

#include "baselines/mesh/pieces.h"
#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// The pieces of a mesh and which of them enclose a volume. Immutable after building; safe to read from many
/// threads.
struct PieceSides {
  struct Piece {
    bool closed = false;
    std::uint32_t outer = 0;  ///< the side of its first facet that looks outside
  };
  Pieces pieces;
  std::vector<Piece> each;
  bool any_closed = false;

  /// O(facets), parallel; the same for any number of threads.
  [[nodiscard]] static PieceSides of(const SurfaceMesh& mesh, int threads);
  [[nodiscard]] std::size_t bytes() const noexcept {
    return pieces.bytes() + each.capacity() * sizeof(Piece);
  }
};

/// A piece that encloses a volume is touched from one side only, the one where the HIP began; any other from
/// both. Facets need not be oriented alike: a piece's sides are those that agree with its first facet. The
/// mesh and its sides must outlive it. Belongs to one thread.
class FreeSide {
 public:
  FreeSide(const SurfaceMesh& mesh, const PieceSides& sides);
  /// The HIP is free at `hip`, local, mm. O(facets) where a piece encloses a volume. Allocates nothing.
  void begin_at(const Vec3& hip) noexcept;
  /// Whether the half-facet can be touched.
  [[nodiscard]] bool touches(HalfFacet half) const noexcept {
    const std::uint32_t piece = sides_->pieces.piece_of(facet_of(half));
    return !sides_->each[piece].closed ||
           (side_of(half) ^ sides_->pieces.side(facet_of(half))) == here_[piece].front;
  }

 private:
  struct Here {
    std::uint32_t front = 0;  ///< the side of its first facet that is touched
    double angle = 0.0;       ///< under which it is seen from the HIP
  };
  const SurfaceMesh* mesh_;
  const PieceSides* sides_;
  std::vector<Here> here_;  ///< of every piece
};

}  // namespace palpate::baselines
