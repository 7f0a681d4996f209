#include "toolkit/smooth/bake.h"

#include <Eigen/Geometry>

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <memory>
#include <mutex>
#include <numeric>
#include <tuple>
#include <utility>

#include "toolkit/core/parallel.h"
#include "toolkit/geometry/mouth.h"
#include "toolkit/smooth/blend.h"
#include "toolkit/smooth/cube_faces.h"
#include "toolkit/smooth/cube_pairs.h"
#include "toolkit/smooth/cube_seams.h"
#include "toolkit/smooth/layers.h"
#include "toolkit/smooth/points_around.h"
#include "toolkit/smooth/seam_bricks.h"
#include "toolkit/smooth/spline.h"
#include "toolkit/smooth/vouchers.h"

namespace palpate::render {
namespace {

/// Half the diagonal of a cell, in voxels.
constexpr double kHalfCellDiagonal = 0.8660254;
/// A cell's middle is at most half its diagonal off a surface that crosses it, where the gradient is one;
/// with room for where it is not quite.
constexpr double kCrossed = 1.1 * kHalfCellDiagonal;
/// Such cells are as many as their slab's volume: of surface each stands for so much, in square voxels,
/// however it lies.
constexpr double kCellArea = 0.5 / kCrossed;
/// The lattice begins this many bricks before the box: faces of a box that stands along the axes are often
/// flat, and lie at no wall this way.
constexpr double kLatticeShift = 1.09;
/// With a mean of its corners farther off than this no surface goes through the cell: its half diagonal with
/// room, and as much again for a slope of more than one and a crease.
constexpr float kNotCrossed = 1.4f;
/// On a narrow ridge, where the distance grows by less than this share of the way, it may go through a corner
/// whose node is so much off it: the spline is not far from its nodes.
constexpr double kNarrow = 0.9;
constexpr float kClipped = 0.1f;
/// A sheet with no more cells beyond its points than these, or this share of its cells, is closed: the
/// smallest hole, two spacings wide, has some eight around it, and a void of chance one.
constexpr std::uint64_t kChanceCells = 4;
constexpr double kChanceShare = 1e-4;
/// Layers so many voxels off have a say in which way the surface lies beside a crease.
constexpr float kBesideCrease = 1.0f;
/// Closed pieces that a brick can name.
constexpr std::size_t kMostPieces = (std::size_t{1} << Brick::kPieceBits) - 1;
/// Cubes a chunk: wide enough that most nodes they have in common are within one, some 11 by 11 cubes of a
/// sheet.
constexpr std::size_t kBrickGrain = 256;

class Baker {
 public:
  Baker(const SmoothPoints& points, const std::vector<Patch>& patches, const PatchLinks& links,
        const Seams& seams, const SmoothWithout& without, BrickGrid& grid)
      : points_(points),
        patches_(patches),
        links_(links),
        seams_(seams),
        without_(without),
        grid_(grid),
        brick_mm_(kBrickCells * grid.voxel_mm) {}

  void run(int threads) {
    cubes_ = find_pairs(patches_, seams_.plain, grid_, threads);
    const std::size_t count = cubes_.codes.size();
    const std::size_t chunks = (count + kBrickGrain - 1) / kBrickGrain;
    std::vector<std::vector<Made>> made(chunks);
    ScratchPool pool;
    parallel_chunks(count, kBrickGrain, threads, [&](std::size_t begin, std::size_t end) {
      std::unique_ptr<Scratch> scratch = pool.take();
      if (!scratch) scratch = std::make_unique<Scratch>(patches_, grid_, without_);
      std::vector<Made>& mine = made[begin / kBrickGrain];
      mine.reserve(end - begin);
      for (std::size_t c = begin; c < end; ++c) bake_cube(cubes_.codes[c], cubes_.of(c), *scratch, mine);
      pool.give_back(std::move(scratch));
    });
    close_pieces(made);
    collect(made);
  }

 private:
  /// A brick, and what decides about its piece.
  struct Made {
    Brick brick;
    std::vector<Brick> more;  ///< layers of its sheet besides
    std::uint64_t code = 0;
    std::uint32_t sheet = 0;
    std::uint64_t beyond = 0;  ///< cells that the surface goes through where no points are around
    /// Of the cells of the mask: sums of the normals, and of the places from the cube's middle, in voxels.
    Vec3 normals = Vec3::Zero(), places = Vec3::Zero();
  };
  struct Scratch {
    Scratch(const std::vector<Patch>& patches, const BrickGrid& grid, const SmoothWithout& without)
        : faces(without.sheets), blend(patches, grid, without) {}
    std::vector<std::uint32_t> members;  ///< patches of the cube
    CubeFaces faces;
    std::vector<std::uint32_t> order;  ///< of one sheet's patches, face by face
    std::vector<std::uint32_t> face;   ///< the patches of one
    Vouchers vouchers;
    PointsAround around;
    std::vector<Brick> layers;  ///< of one sheet that has several, as frames read them
    CubeSeams seams;
    NodeBlend blend;
  };

  /// What no chunk uses now: memory is taken, and forgotten, once a thread.
  class ScratchPool {
   public:
    std::unique_ptr<Scratch> take() {
      const std::lock_guard lock(mutex_);
      if (idle_.empty()) return nullptr;
      std::unique_ptr<Scratch> one = std::move(idle_.back());
      idle_.pop_back();
      return one;
    }
    void give_back(std::unique_ptr<Scratch> one) {
      const std::lock_guard lock(mutex_);
      idle_.push_back(std::move(one));
    }

   private:
    std::mutex mutex_;
    std::vector<std::unique_ptr<Scratch>> idle_;
  };

  /// The patches of one sheet, face by face, each body's faces in a row.
  static void put_in_order(std::size_t patches, std::uint32_t sheet, Scratch& s) {
    s.order.clear();
    for (std::uint32_t i = sheet; i < patches; ++i)
      if (s.faces.sheet(i) == sheet) s.order.push_back(i);
    std::sort(s.order.begin(), s.order.end(), [&](std::uint32_t x, std::uint32_t y) {
      return std::make_tuple(s.faces.body(x), s.faces.face(x), x) <
             std::make_tuple(s.faces.body(y), s.faces.face(y), y);
    });
  }
  /// Over a seam its sides, each by itself; or, beside it, that which is in the cube. False, with nothing
  /// put, where there is none, or the sides do not meet.
  bool put_seams(std::span<const CubePatch> pairs, const Vec3& middle, Scratch& s, Made& out) const {
    if (seams_.all.empty() || s.faces.face(s.order.front()) != s.faces.face(s.order.back())) return false;
    s.face.clear();
    for (const std::uint32_t i : s.order) s.face.push_back(pairs[i].patch);
    if (!s.seams.part(s.face, patches_, seams_, middle, kHalfCells * grid_.voxel_mm)) return false;
    for (std::size_t side = 0; side < std::size_t{1} << s.seams.lines(); ++side)
      if (!s.blend.alone(side, s.seams.patches(side))) return false;
    const std::vector<Brick> bricks = seam_bricks(s.seams, s.blend, middle, grid_.voxel_mm);
    if (bricks.empty()) return false;
    out.brick = bricks.front();
    out.more.assign(bricks.begin() + 1, bricks.end());
    return true;
  }
  /// The distance of a sheet, each of its faces a layer where they meet in creases.
  void put_faces(std::span<const CubePatch> pairs, Scratch& s, Made& out) const {
    s.face.clear();
    for (std::size_t k = 0; k < s.order.size(); ++k) {
      const std::uint32_t i = s.order[k];
      s.face.push_back(pairs[i].patch);
      const bool last = k + 1 == s.order.size();
      if (last || s.faces.face(s.order[k + 1]) != s.faces.face(i)) {
        s.blend.add_face(s.face);
        s.face.clear();
      }
      if (last || s.faces.body(s.order[k + 1]) != s.faces.body(i)) s.blend.end_ridge();
    }
    const std::array<float, kBrickCoefficients>& joined = s.blend.finish();
    const std::span<const NodeBlend::Layer> layers =
        without_.layers ? std::span<const NodeBlend::Layer>() : s.blend.layers();
    out.brick.put(layers.empty() ? joined : layers.front().distance);
    if (layers.size() < 2) return;
    out.brick.set(0, layers.front().on);
    for (const NodeBlend::Layer& layer : layers.subspan(1)) {
      Brick& next = out.more.emplace_back();
      next.put(layer.distance);
      next.set(0, layer.on);
    }
  }

  /// The patches of a cube, sheet by sheet.
  void bake_cube(std::uint64_t code, std::span<const CubePatch> pairs, Scratch& s,
                 std::vector<Made>& made) const {
    s.members.clear();
    for (const CubePatch& pair : pairs) s.members.push_back(pair.patch);
    const BrickGrid::Coordinate c = coordinate_of(code);
    const Vec3 middle = grid_.low_mm + Vec3(c[0] + 0.5, c[1] + 0.5, c[2] + 0.5) * brick_mm_;
    s.faces.part(s.members, patches_, links_, middle, kHalfNodes * grid_.voxel_mm);
    for (std::uint32_t sheet = 0; sheet < pairs.size(); ++sheet) {
      if (s.faces.sheet(sheet) != sheet) continue;
      bool through = false;
      double spacing = 0.0;
      for (std::uint32_t i = sheet; i < pairs.size(); ++i) {
        if (s.faces.sheet(i) != sheet) continue;
        const Patch& p = patches_[pairs[i].patch];
        through |= pairs[i].through != 0;
        spacing = std::max(spacing, p.spacing);
      }
      if (!through) continue;
      put_in_order(pairs.size(), sheet, s);
      s.blend.begin(c);
      Made& out = made.emplace_back();
      if (!put_seams(pairs, middle, s, out)) put_faces(pairs, s, out);
      out.code = code;
      out.sheet = links_.sheet[pairs[sheet].patch];
      set_mask(pairs, out, middle, spacing, s);
      if ((out.brick.mask | out.beyond) == 0) made.pop_back();
    }
  }

  /// The mean at a cell's corners: the spline at its middle is within a few hundredths of it.
  static float coefficients_about(const Brick& brick, const std::array<int, 3>& cell) {
    int sum = 0;
    for (int corner = 0; corner < 8; ++corner) {
      const int x = cell[0] + 1 + corner / 4, y = cell[1] + 1 + corner / 2 % 2, z = cell[2] + 1 + corner % 2;
      const int node = (x * kBrickNodes + y) * kBrickNodes + z;
      sum += brick.distance[static_cast<std::size_t>(node)];
    }
    return kBrickUnit * 0.125f * static_cast<float>(sum);
  }
  /// Whether the surface goes through a corner of a cell, `middle` off its middle.
  static bool clipped(const Brick& brick, const std::array<int, 3>& cell, float middle) {
    const float side = middle > 0.0f ? 1.0f : -1.0f;
    for (int corner = 0; corner < 8; ++corner) {
      const int x = cell[0] + 1 + corner / 4, y = cell[1] + 1 + corner / 2 % 2, z = cell[2] + 1 + corner % 2;
      const int node = (x * kBrickNodes + y) * kBrickNodes + z;
      if (side * kBrickUnit * brick.distance[static_cast<std::size_t>(node)] < kClipped) return true;
    }
    return false;
  }
  /// The cells that the surface goes through, but for those beyond where the points end.
  void set_mask(std::span<const CubePatch> pairs, Made& out, const Vec3& middle, double spacing,
                Scratch& s) const {
    s.around.begin(points_, middle, kHalfDiagonal * grid_.voxel_mm, spacing);
    s.vouchers.begin(middle);
    for (const std::uint32_t i : s.order) s.vouchers.add(patches_[pairs[i].patch]);
    Brick& brick = out.brick;
    s.layers.clear();
    if (!out.more.empty()) {
      s.layers.push_back(brick);
      s.layers.insert(s.layers.end(), out.more.begin(), out.more.end());
    }
    for (int cell = 0; cell < kBrickCells * kBrickCells * kBrickCells; ++cell) {
      BrickPlace at;
      at.cell = {cell / 16, cell / 4 % 4, cell % 4};
      at.t = {0.5f, 0.5f, 0.5f};
      if (out.more.empty() && std::abs(coefficients_about(brick, at.cell)) > kNotCrossed) continue;
      const Jet jet = s.layers.empty() ? spline_jet(brick, at) : layers_jet(s.layers.data(), at);
      const double slope = static_cast<double>(jet.gradient.norm());
      if (!(slope > 0.0)) continue;
      const bool crossed = std::abs(static_cast<double>(jet.value)) <= kCrossed * std::max(slope, 0.5);
      if (!crossed && !(out.more.empty() && slope < kNarrow && clipped(brick, at.cell, jet.value))) continue;
      Vec3 n = jet.gradient.cast<double>() / slope;
      Vec3 to = -n * (static_cast<double>(jet.value) / slope);
      if (!s.layers.empty()) beside_crease(s.layers.data(), at, jet.value, n, to);
      const Vec3 foot = (Vec3(at.cell[0] - 1.5, at.cell[1] - 1.5, at.cell[2] - 1.5) + to) * grid_.voxel_mm;
      if (!without_.borders && !s.vouchers.vouch_for(foot) && !s.around.are_around(foot, n)) {
        out.beyond |= std::uint64_t{1} << cell;
        continue;
      }
      brick.mask |= std::uint64_t{1} << cell;
      out.normals += n;
      out.places += foot * grid_.per_voxel;
    }
  }
  /// Of a sheet with layers: `to` the nearest place of it, which may be a crease, and the normal there in the
  /// mean over the layers next to it: along that of one the points beyond its crease are seen askew, or not.
  static void beside_crease(const Brick* first, BrickPlace at, float value, Vec3& n, Vec3& to) {
    const NewtonStep step = layers_step(first, at, Vec3::Zero(), value > 0.0f ? -1.0 : 1.0, kCrossed);
    to = step.along + step.normal * step.lift;
    for (std::size_t a = 0; a < 3; ++a) at.t[a] += static_cast<float>(to[static_cast<Eigen::Index>(a)]);
    n = layers_normal(first, at, kBesideCrease);
  }
  struct Piece {
    std::uint64_t cells = 0, beyond = 0, bricks = 0, seen = 0;
    std::uint16_t number = 0;
    std::vector<geometry::SurfacePart> parts;
    /// What chance left out is no border.
    [[nodiscard]] bool closed() const {
      const double chance = kChanceShare * static_cast<double>(cells);
      return static_cast<double>(beyond) <= std::max(chance, double{kChanceCells});
    }
  };
  static geometry::SurfacePart part_of(const Made& one) {
    const BrickGrid::Coordinate c = coordinate_of(one.code);
    const Vec3 middle = (Vec3(c[0], c[1], c[2]) + Vec3::Constant(0.5)) * kBrickCells +
                        one.places / std::popcount(one.brick.mask);
    return {middle.cast<float>(), (one.normals * kCellArea).cast<float>()};
  }
  /// Numbers the pieces that are felt from one side: those without a border, to which belongs what chance
  /// left out of them, and those that enclose a volume but for holes, which stay.
  void close_pieces(std::vector<std::vector<Made>>& made) {
    std::vector<Piece> pieces(patches_.size());
    for (const std::vector<Made>& m : made)
      for (const Made& one : m) {
        Piece& piece = pieces[one.sheet];
        piece.cells += static_cast<std::uint64_t>(std::popcount(one.brick.mask));
        piece.beyond += static_cast<std::uint64_t>(std::popcount(one.beyond));
        ++piece.bricks;
        if (one.brick.mask != 0) piece.parts.push_back(part_of(one));
      }
    for (Piece& piece : pieces) {
      if (piece.cells == 0 || grid_.closed_pieces.size() == kMostPieces) continue;
      ClosedPiece closed;
      if (!piece.closed()) {
        if (without_.enclosure) continue;
        closed.outer_side = geometry::outer_side(piece.parts);
        if (closed.outer_side == 0.0f) continue;
        grid_.least_enclosed = std::min(grid_.least_enclosed, 1.0 - geometry::mouth_share(piece.parts));
        closed.parts = std::move(piece.parts);
      }
      grid_.closed_pieces.push_back(std::move(closed));
      piece.number = static_cast<std::uint16_t>(grid_.closed_pieces.size());
    }
    for (std::vector<Made>& m : made)
      for (Made& one : m) {
        Piece& piece = pieces[one.sheet];
        if (piece.number == 0) continue;
        one.brick.set(piece.number, one.brick.joint());
        for (Brick& more : one.more) more.set(piece.number, more.joint());
        ClosedPiece& closed = grid_.closed_pieces[piece.number - 1u];
        if (closed.outer_side != 0.0f) continue;
        one.brick.mask |= one.beyond;
        const std::uint64_t at = piece.seen++;
        for (std::size_t k = 0; k < kPieceSamples; ++k)
          if (at == piece.bricks * (2 * k + 1) / (2 * kPieceSamples)) closed.samples[k] = place_of(one);
      }
  }
  /// The middle of some cell that the surface goes through, in voxels.
  static Eigen::Vector3f place_of(const Made& one) {
    const int cell = std::countr_zero(one.brick.mask);
    const BrickGrid::Coordinate c = coordinate_of(one.code);
    return Eigen::Vector3f(static_cast<float>(kBrickCells * c[0]), static_cast<float>(kBrickCells * c[1]),
                           static_cast<float>(kBrickCells * c[2])) +
           Eigen::Vector3f(static_cast<float>(cell / 16) + 0.5f, static_cast<float>(cell / 4 % 4) + 0.5f,
                           static_cast<float>(cell % 4) + 0.5f);
  }

  void collect(const std::vector<std::vector<Made>>& made) {
    std::size_t count = 0;
    for (const std::vector<Made>& m : made)
      for (const Made& one : m) count += one.brick.mask != 0 ? 1 + one.more.size() : 0;
    grid_.bricks.reserve(count);
    std::vector<std::uint64_t> cells;
    for (const std::vector<Made>& m : made)
      for (const Made& one : m) {
        if (one.brick.mask == 0) continue;
        if (cells.empty() || cells.back() != one.code) {
          cells.push_back(one.code);
          grid_.first.push_back(static_cast<std::uint32_t>(grid_.bricks.size()));
        }
        grid_.bricks.push_back(one.brick);
        for (const Brick& more : one.more) grid_.bricks.push_back(more);
      }
    grid_.first.push_back(static_cast<std::uint32_t>(count));
    grid_.first.shrink_to_fit();
    grid_.table.build(cells);
  }

  const SmoothPoints& points_;
  const std::vector<Patch>& patches_;
  const PatchLinks& links_;
  const Seams& seams_;
  const SmoothWithout& without_;
  BrickGrid& grid_;
  double brick_mm_;
  CubePatches cubes_;
};

}  // namespace

std::vector<BrickGrid::Coordinate> BrickGrid::cubes_of_bricks() const {
  const std::vector<std::uint64_t> codes = table.codes(first.size() - 1);
  std::vector<Coordinate> out(bricks.size());
  for (std::size_t cell = 0; cell + 1 < first.size(); ++cell)
    for (std::uint32_t b = first[cell]; b < first[cell + 1]; ++b) out[b] = coordinate_of(codes[cell]);
  return out;
}

BrickGrid bake_bricks(const SmoothPoints& points, const std::vector<Patch>& patches, const PatchLinks& links,
                      const Seams& seams, double voxel_mm, int threads, const SmoothWithout& without) {
  BrickGrid grid;
  const double brick_mm = kBrickCells * voxel_mm;
  grid.voxel_mm = voxel_mm;
  grid.per_voxel = 1.0 / voxel_mm;
  grid.box_mm = points.box_mm();
  grid.low_mm = grid.box_mm.low_mm - Vec3::Constant(kLatticeShift * brick_mm);
  const double bricks = (grid.box_mm.high_mm - grid.low_mm).maxCoeff() / brick_mm + 2.0;
  grid.last_brick = std::min<std::int64_t>(static_cast<std::int64_t>(bricks),
                                           (std::int64_t{1} << partition::kMortonBits) - 1);
  Baker(points, patches, links, seams, without, grid).run(threads);
  return grid;
}

}  // namespace palpate::render
