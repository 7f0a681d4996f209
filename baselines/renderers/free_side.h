// From which side the pieces of a mesh are touched.
#pragma once

#include <cstdint>
#include <vector>

#include "baselines/mesh/pieces.h"
#include "baselines/mesh/surface_mesh.h"

namespace palpate::baselines {

/// A piece that encloses a volume is touched from one side only, the one where the HIP began; any other from
/// both. Facets need not be oriented alike: a piece's sides are those that agree with its first facet. The
/// mesh must outlive it. Belongs to one thread.
class FreeSide {
 public:
  /// O(facets).
  explicit FreeSide(const SurfaceMesh& mesh);
  /// The HIP is free at `hip`, local, mm. O(facets) where a piece encloses a volume. Allocates nothing.
  void begin_at(const Vec3& hip) noexcept;
  /// Whether the half-facet can be touched.
  [[nodiscard]] bool touches(HalfFacet half) const noexcept {
    const Piece& piece = pieces_[pieces_of_.piece_of(facet_of(half))];
    return !piece.closed || (side_of(half) ^ pieces_of_.side(facet_of(half))) == piece.front;
  }
  [[nodiscard]] std::size_t bytes() const noexcept {
    return pieces_of_.bytes() + pieces_.capacity() * sizeof(Piece);
  }

 private:
  struct Piece {
    bool closed = false;
    std::uint32_t outer = 0, front = 0;  ///< sides of its first facet: what is outside, what is touched
    double angle = 0.0;                  ///< under which it is seen from the HIP
  };
  const SurfaceMesh* mesh_;
  Pieces pieces_of_;
  std::vector<Piece> pieces_;
  bool any_closed_ = false;
};

}  // namespace palpate::baselines
