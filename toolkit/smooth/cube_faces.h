// The patches of one cube, parted into sheets, and each sheet into faces that creases bound: the distance of
// a face is blended of its patches, that of a body is the greatest of its faces', that of a sheet the least
// of its bodies'.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "toolkit/smooth/patch_links.h"

namespace palpate::render {

/// Scratch that is used again from cube to cube. Belongs to one thread.
class CubeFaces {
 public:
  /// `all_one`: every patch of a cube is of one sheet.
  explicit CubeFaces(bool all_one = false) : all_one_(all_one) {}
  /// `members`: the cube's patches, ascending; `middle`: of the cube; `half`: of its edge. O(links of the
  /// patches), and O(members^2) where they are not all linked, or make several faces.
  void part(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
            const PatchLinks& links, const Vec3& middle, double half);
  /// Of a member: the first of its sheet; what is told apart by face and body.
  [[nodiscard]] std::uint32_t sheet(std::size_t i) const noexcept { return sheet_[i]; }
  [[nodiscard]] std::uint32_t face(std::size_t i) const noexcept { return face_[i]; }
  [[nodiscard]] std::uint32_t body(std::size_t i) const noexcept { return body_[i]; }

 private:
  struct Crease {
    std::uint32_t a, b;
    Turn turn;
    int points;  ///< the lesser of both patches'
  };
  struct Face {
    std::uint32_t name, sheet, body;
  };
  struct Doubtful {
    std::uint32_t patch, sure;
    double off;
  };
  /// Patches that go on without a crease are one face, those of many points first: what is joined by few does
  /// not join faces that more points tell apart.
  void join_faces();
  [[nodiscard]] bool one_face();
  /// The same, told without looking at all links: no crease is near, and the patches that go on from the
  /// first are all of them.
  [[nodiscard]] bool all_go_on(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
                               const PatchLinks& links);
  /// Patches of one sheet that are the same surface here go together, too, where no link says so.
  void join_same(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
                 const PatchLinks& links, const Vec3& middle);
  /// A doubtful patch makes no face of two: it goes with the sure one that it lies nearest to.
  void settle_doubtful();
  /// A face of few points is none, nor one that meets no other in a crease: both go with another face of the
  /// sheet. Cubes beside each other would not agree about them.
  void settle_small(std::span<const std::uint32_t> members, const std::vector<Patch>& patches);
  /// Faces that meet in ridges more than in valleys are of one body there; bodies stand beside each other.
  void part_bodies();
  /// A crease holds where it is, and decides for the whole cube: a face that would be hidden where its own
  /// points are becomes a sheet of its own.
  void part_hidden(std::span<const std::uint32_t> members, const std::vector<Patch>& patches,
                   const Vec3& middle, double half);
  void take_out(const Face& face);
  void find_faces();
  /// Of the places of a face in the cube, weighed by their points, the share at which the sheet is elsewhere.
  [[nodiscard]] double hidden_share(const Face& face, std::span<const std::uint32_t> members,
                                    const std::vector<Patch>& patches, const Vec3& middle, double half);
  /// Of the sheet's faces at a place, as the bricks join them.
  [[nodiscard]] double joined_distance(std::uint32_t sheet, std::span<const std::uint32_t> members,
                                       const std::vector<Patch>& patches, const Vec3& at);

  bool all_one_;
  std::vector<std::uint32_t> number_;   ///< of a patch that is a member of the cube, in it
  std::vector<std::uint32_t> reached_;  ///< patches that go on from the first
  std::vector<std::uint32_t> sheet_, face_, body_;
  std::vector<Crease> creases_, goes_on_;
  std::vector<Doubtful> doubtful_;
  std::vector<int> weight_;  ///< points of each face
  std::vector<std::uint8_t> creased_;
  std::vector<Face> faces_;             ///< of the cube
  std::vector<double> weights_, sums_;  ///< by face
};

}  // namespace palpate::render
