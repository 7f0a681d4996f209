// Probe paths and force traces: an experiment's input and output.
//
// First:
//   auto path = palpate::trace::read_path_csv("probe.csv");
//   if (!path) return failed(path.error());  // with its line
//   path->t_s.push_back(path->t_s.back() + 1e-3);
//   path->hip_mm.push_back({0.0, 0.0, 39.0});
//   auto wrote = palpate::trace::write_path_csv(*path, "longer.csv");
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include <palpate/renderer.h>
#include <palpate/result.h>
#include <palpate/vec.h>

namespace palpate::trace {

/// HIP positions over time, world frame. Times strictly increase.
struct ProbePath {
  std::string name;  ///< the file or the generator with its parameters
  std::vector<double> t_s;
  std::vector<Vec3> hip_mm;
  [[nodiscard]] std::size_t size() const noexcept { return t_s.size(); }
};

/// A path in somebody else's memory: `t_s` is as long as `hip_mm`.
struct PathView {
  std::string_view name;
  std::span<const double> t_s;
  std::span<const Vec3> hip_mm;

  PathView(const ProbePath& path) : name(path.name), t_s(path.t_s), hip_mm(path.hip_mm) {}  // NOLINT: a view
  PathView(std::string_view of, std::span<const double> times_s, std::span<const Vec3> hips_mm)
      : name(of), t_s(times_s), hip_mm(hips_mm) {}
  [[nodiscard]] std::size_t size() const noexcept { return t_s.size(); }
};

/// A renderer's answers, one per path sample.
struct ForceTrace {
  std::string label;
  std::vector<render::Frame> frames;
  std::vector<std::int64_t> frame_ns;  ///< per frame, clock cost included; empty if not timed
};

/// FNV-1a-64 over contact, force and god object of every frame, without times. Sixteen hexadecimal digits.
[[nodiscard]] std::string trace_hash(const ForceTrace& trace);

/// The same hash over the times and positions of a path.
[[nodiscard]] std::string path_hash(const ProbePath& path);

/// The truth at one path sample.
struct TruthFrame {
  render::Frame frame;          ///< force, god object, contact of the true surface
  Vec3 normal = Vec3::UnitZ();  ///< outward, at the true god object (when free: at the nearest surface point)
  double signed_distance_mm =
      0.0;  ///< of the HIP: minus the depth below the true god object in contact, else the distance
  double local_resolution_mm = 0.0;  ///< distance from the nearest cloud point there to its eighth neighbour
  /// A second reference without history gives a different answer: the truth depends on the way.
  bool history_decides = false;
};

/// The truth along a path.
struct ReferenceTrace {
  std::string name;       ///< "analytic", "original-mesh", "closest-point"
  std::string exactness;  ///< in words with numbers
  bool compared = false;  ///< a second reference was used: history_decides is valid
  std::vector<TruthFrame> frames;
};

// Probe paths and force traces as text: CSV in and out, and the .traj files of Ruffaldi et al. 2006. Numbers
// have the fewest digits that read back to the same bits; files are written atomically. Reading checks
// everything; an Error has file, line and remedy. Memory is bounded and proportional to the file. Blank lines
// and a UTF-8 byte order mark are skipped.

inline constexpr const char* kPathHeader = "t_s,x_mm,y_mm,z_mm";
inline constexpr const char* kTraceHeader =
    "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,frame_ns";

inline constexpr const char* kReferenceHeader =
    "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,nx,ny,nz,distance_mm,resolution_mm";
/// Header of a compared truth: history_decides, 0 or 1, comes last.
inline constexpr const char* kComparedReferenceHeader =
    "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,nx,ny,nz,distance_mm,resolution_mm,history";

/// Needs exactly kPathHeader, at least one row, finite numbers and strictly increasing times.
[[nodiscard]] Result<ProbePath> read_path_csv(const std::string& file,
                                              std::uint64_t max_bytes = kMemoryLimitBytes);
[[nodiscard]] Status write_path_csv(const ProbePath& path, const std::string& file);

/// Writes one row per path sample; frame_ns is 0 if not timed. Differing lengths are an Error.
[[nodiscard]] Status write_trace_csv(const ProbePath& path, const ForceTrace& trace, const std::string& file);

struct PathAndTrace {
  ProbePath path;
  ForceTrace trace;  ///< the file lacks model and status: model is 0 in contact, else -1; status is kOk
};
[[nodiscard]] Result<PathAndTrace> read_trace_csv(const std::string& file,
                                                  std::uint64_t max_bytes = kMemoryLimitBytes);

/// Writes the truth of every sample: force, god object, normal, signed distance, local resolution, and
/// history_decides if known. Differing lengths are an Error.
[[nodiscard]] Status write_reference_csv(const ProbePath& path, const ReferenceTrace& reference,
                                         const std::string& file);

struct PathAndReference {
  ProbePath path;
  ReferenceTrace reference;  ///< the file lacks its name and exactness
};
[[nodiscard]] Result<PathAndReference> read_reference_csv(const std::string& file,
                                                          std::uint64_t max_bytes = kMemoryLimitBytes);

/// The columns of a .traj file, counted from 0; -1 means absent.
struct TrajColumns {
  int t = 0;
  int x = 1, y = 2, z = 3;
  int fx = -1, fy = -1, fz = -1;
  double mm_per_unit = 1.0;     ///< scale of positions
  double n_per_unit = 1.0;      ///< scale of forces
  double s_per_unit = 1.0;      ///< scale of times
  double sample_rate_hz = 0.0;  ///< used if t = -1
};
struct TrajRecording {
  ProbePath path;
  std::vector<Vec3> force_n;  ///< as long as the path with force columns, else empty
};
/// Reads lines of numbers separated by blanks, tabs, commas or semicolons. Skips empty lines, lines starting
/// with # or %, and a first line without numbers (column names).
[[nodiscard]] Result<TrajRecording> read_traj(const std::string& file, const TrajColumns& columns,
                                              std::uint64_t max_bytes = kMemoryLimitBytes);

}  // namespace palpate::trace
