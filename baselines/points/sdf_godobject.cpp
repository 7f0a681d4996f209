#include "baselines/rivals.h"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <palpate/result.h>
#include "baselines/points/point_grid.h"
#include "baselines/points/rival.h"
#include "baselines/points/sdf_grid.h"
#include "toolkit/render/prepare.h"

namespace palpate::baselines {
namespace {

constexpr double kSdfBytesPerMb = 1e6;
/// Most steps of the search for an entry in a frame; the next frame continues. A HIP at 5 m/s moves 5 mm in a
/// frame, some 25 steps in the band at voxels of 0.2 mm.
constexpr int kMaxTraceSteps = 512;
/// A step through the band is this share of the distance there, since a weighted distance may be too long.
constexpr double kTraceShare = 0.8;
/// Least step as a share of a voxel; it does not step over a sheet two voxels thick.
constexpr double kMinTrace = 0.25;
/// Halvings of a step of some voxels that crosses the zero set; they reach a millionth of a voxel.
constexpr int kSdfHalvings = 24;
/// Most moves of the god object in a frame, and the longest one in voxels, which stays within the band
/// however deep the HIP is.
constexpr int kMaxSdfMoves = 64;
constexpr double kMoveVoxels = 1.0;
/// Newton steps back to the zero set, and the distance in voxels that counts as on it.
constexpr int kSdfNewton = 8;
constexpr double kOnSurface = 1e-6;
/// The god object rests if the pull along the surface is below this share of the pull (a twentieth of a
/// degree), or if a move was halved so often without coming nearer to the HIP.
constexpr double kSdfRest = 1e-3;
constexpr int kMoveHalvings = 6;
/// A place is past a border if the nearest point is so many gaps beside; between points it is at most one.
constexpr double kSdfBesideGaps = 1.5;
/// The weights' width in voxels' units (closing spacings): the planes of a gap's whole rim count.
constexpr double kSdfWidth = 0.75;

class SdfGodobject : public RivalModel {
 public:
  static constexpr RivalText kText{
      "sdf-godobject", "a god object on a grid of distances to the points",
      "OpenVDB grids (Museth 2013); distances to planes of points after Hoppe et al. 1992; god object after "
      "Zilles and Salisbury 1995: as put together here, ours",
      0.30, 3'300.0};  // sinusoid of a million
  static constexpr bool kGodObject = true;
  static std::vector<OptionSpec> specs() {
    return {
        option::in_spacings("voxel", "1", "edge of a voxel in mean spacings (of uneven clouds: in gaps)", 0.1,
                            1000.0),
        option::in_mm("voxel"),
        option::integer("band", "3", "voxels on each side of the points that hold a distance", 2, 64),
        option::number("memory_mb", "2000", "limit of the grid's memory", 0.001, 1e6),
        option::flag("flip", "false", "of surfaces with a border: take the other side for outside"),
    };
  }
  Status decide(const RivalInput& given, render::ModelDecisions& out) {
    const auto& [input, options, context, report] = given;
    const Gaps gaps = measured_gaps(*input.cloud, context, report, &out);
    neighbours_ = gaps.neighbours();
    SdfOptions& wanted = wanted_;
    wanted.voxel_mm = option::length_mm(options, "voxel", gaps.closing_mm());
    wanted.band = static_cast<int>(options.integer("band"));
    wanted.width_mm = kSdfWidth * gaps.closing_mm();
    wanted.beside_mm = kSdfBesideGaps * gaps.closing_mm();
    wanted.most_bytes = static_cast<std::size_t>(options.number("memory_mb") * kSdfBytesPerMb);
    report_normals(*input.cloud, neighbours_, out);
    out.decisions.push_back({"field", fmt::format("voxels of {:.4g} mm", wanted.voxel_mm),
                             fmt::format("signed distances within {} voxels of the points, by OpenVDB; at "
                                         "most {:.4g} MB, else it is refused",
                                         wanted.band, options.number("memory_mb")),
                             options.number("voxel_mm") > 0.0});
    return Done{};
  }
  Status prepare(const RivalInput& given) {
    const auto& [input, options, context, report] = given;
    render::PreparePhases phases(report, context);
    PALPATE_ASSIGN(OrientedGrid built,
                   build_oriented_grid(input, 2.0 * wanted_.voxel_mm, neighbours_, false, context, report));
    const PointGrid& points = built.points;
    phases.begin("sphere tree");
    SphereTree tree;
    tree.build(points.points, context.threads);
    phases.end();
    phases.begin("distances (OpenVDB)");
    wanted_.open_sign = open_sign(points.points) * (options.flag("flip") ? -1.0 : 1.0);
    PALPATE_ASSIGN(field_, SdfGrid::build(points, tree, wanted_, context.threads));
    phases.end();
    report.bytes += field_.bytes();
    report.notes.push_back(fmt::format("voxel {:.4g} mm, {} voxels, {:.1f} MB", field_.voxel_mm(),
                                       field_.voxels(),
                                       static_cast<double>(field_.bytes()) / kSdfBytesPerMb));
    if (!built.closed)
      phases.warn(
          "the surface has a border: sdf-godobject feels it from one side alone (option flip takes the "
          "other), and up to one and a half gaps past the border");
    return Done{};
  }
  [[nodiscard]] std::string work_bound() const {
    return fmt::format(
        "at most {} steps of a look-up of eight samples towards the HIP, then {} halvings; in contact at "
        "most {} moves, each halved at most {} times, of at most {} look-ups. A surface with a border is "
        "felt from one side alone; sheets nearer than two voxels merge",
        kMaxTraceSteps, kSdfHalvings, kMaxSdfMoves, kMoveHalvings, kSdfNewton + 1);
  }

  void release_contact(const Vec3& h) noexcept {
    previous_ = h;
    outside_ = true;
    touching_ = false;
    state.release();
  }
  [[nodiscard]] RivalAnswer update(const Vec3& h, render::FrameCounters& counters) noexcept {
    bool finished = true;
    if (!touching_) finished = look_for_entry(h, counters);
    RivalAnswer answer;
    if (touching_) {
      finished = slide(h, counters) && finished;
      const Vec3 pull = proxy_.at - h;
      if (proxy_.normal.dot(pull) > 0.0) {
        answer = {true, false, pull, Vec3::Zero()};
      } else {
        touching_ = false;
        previous_ = h;
        outside_ = true;
      }
    }
    answer.bound_hit = !finished;
    return answer;
  }

 private:
  /// A place on the zero set, and the unit normal there.
  struct OnZero {
    Vec3 at, normal;
  };
  /// Newton's steps along the gradient to the zero set. Nothing if they leave what is known.
  [[nodiscard]] std::optional<OnZero> project(Vec3 at) noexcept {
    const double reached = kOnSurface * field_.voxel_mm();
    for (int i = 0; i <= kSdfNewton; ++i) {
      const SdfGrid::Value value = field_.at(at);
      const double slope_sq = value.gradient.squaredNorm();
      if (!value.known || !(slope_sq > 0.0)) return std::nullopt;
      // The last step may cross between cells to and fro: a hundredth of a voxel suffices.
      if (std::abs(value.distance) <= reached || i == kSdfNewton) {
        constexpr double kNearly = 1e-2;
        if (std::abs(value.distance) > kNearly * field_.voxel_mm()) return std::nullopt;
        return OnZero{at, value.gradient / std::sqrt(slope_sq)};
      }
      at -= value.gradient * (value.distance / slope_sq);
    }
    return std::nullopt;
  }
  /// Follows the HIP's segment in steps that the distances allow. False at the bound; the next frame follows
  /// the rest.
  bool look_for_entry(const Vec3& h, render::FrameCounters& counters) noexcept {
    const Vec3 from = previous_, way = h - from;
    const double length = stable_norm(way), voxel = field_.voxel_mm();
    double first = 0.0, last = 1.0;
    if (!(length > 0.0) || !std::isfinite(length) || !field_.clip(from, h, first, last)) {
      previous_ = h;
      return true;
    }
    const Vec3 along = way / length;
    const double end = last * length;
    Vec3 before = from;
    double done = first * length;
    for (int step = 0; step < kMaxTraceSteps; ++step) {
      ++counters.cells_visited;
      const Vec3 at = done < end || last < 1.0 ? Vec3(from + along * done) : h;
      const SdfGrid::Value value = field_.at(at);
      if (value.known) {
        if (value.distance < 0.0 && outside_ && enter(before, at)) return true;
        outside_ = value.distance >= 0.0;
      }
      if (done >= end) {
        previous_ = h;
        return true;
      }
      before = at;
      const double free = value.known ? std::max(kTraceShare * std::abs(value.distance), kMinTrace * voxel)
                                      : field_.empty_mm(at, along);
      done = std::min(done + free, end);
    }
    previous_ = before;
    return false;
  }
  /// Enters between a place outside and one inside. False if the zero set there has no gradient.
  bool enter(const Vec3& outside, const Vec3& inside) noexcept {
    Vec3 out = outside, in = inside;
    for (int i = 0; i < kSdfHalvings; ++i) {
      const Vec3 middle = 0.5 * (out + in);
      const SdfGrid::Value value = field_.at(middle);
      (value.known && value.distance < 0.0 ? in : out) = middle;
    }
    const std::optional<OnZero> on = project(in);
    if (!on) return false;
    proxy_ = *on;
    touching_ = true;
    return true;
  }
  /// Moves towards the place of the zero set nearest to the HIP, along the tangent plane and back to the zero
  /// set, as long as it comes nearer. False at the bound.
  bool slide(const Vec3& h, render::FrameCounters& counters) noexcept {
    for (int move = 0; move < kMaxSdfMoves; ++move) {
      const Vec3 pull = h - proxy_.at;
      Vec3 along = pull - proxy_.normal * proxy_.normal.dot(pull);
      const double size = along.norm(), most = kMoveVoxels * field_.voxel_mm();
      if (!(size > kSdfRest * pull.norm())) return true;
      ++counters.walk_steps;
      if (size > most) along *= most / size;
      bool nearer = false;
      for (int half = 0; half < kMoveHalvings && !nearer; ++half, along *= 0.5) {
        const std::optional<OnZero> next = project(proxy_.at + along);
        if (!next || !((h - next->at).squaredNorm() < pull.squaredNorm())) continue;
        proxy_ = *next;
        nearer = true;
      }
      if (!nearer) return true;  // a concave edge, a border, or rounding
    }
    return false;
  }

  SdfGrid field_;
  Vec3 previous_ = Vec3::Zero();
  bool outside_ = true;  ///< the last known sign on the HIP's way, or nothing known yet
  bool touching_ = false;
  OnZero proxy_{Vec3::Zero(), Vec3::UnitZ()};
  SdfOptions wanted_;  ///< this and what follows: for preparation
  std::string neighbours_;
};

}  // namespace

render::RendererInfo sdf_godobject_info() {
  return rival_info<SdfGodobject>();
}

}  // namespace palpate::baselines
