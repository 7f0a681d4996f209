// Probe paths and force traces as text: CSV in and out, and the .traj files of Ruffaldi et al. 2006. Numbers
// are written with the fewest digits that read back to the same bits; files are written atomically. Reading
// checks everything and names file, line and remedy; memory is proportional to the file and bounded. Blank
// lines and a byte order mark of UTF-8 are passed over.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "toolkit/core/input_file.h"
#include "toolkit/core/result.h"
#include "toolkit/trace/trace.h"

namespace palpate::trace {

inline constexpr const char* kPathHeader = "t_s,x_mm,y_mm,z_mm";
inline constexpr const char* kTraceHeader =
    "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,frame_ns";

inline constexpr const char* kReferenceHeader =
    "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,nx,ny,nz,distance_mm,resolution_mm";
/// Of a truth that was compared with a second reference: history_decides, 0 or 1, comes last.
inline constexpr const char* kComparedReferenceHeader =
    "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,nx,ny,nz,distance_mm,resolution_mm,history";

/// Header exactly kPathHeader, at least one row, finite numbers, time strictly increasing.
[[nodiscard]] Result<ProbePath> read_path_csv(const std::string& file,
                                              std::uint64_t max_bytes = kMemoryLimitBytes);
[[nodiscard]] Status write_path_csv(const ProbePath& path, const std::string& file);

/// One row per row of the path; frame_ns is 0 where the trace was not timed. Lengths that differ are an
/// Error.
[[nodiscard]] Status write_trace_csv(const ProbePath& path, const ForceTrace& trace, const std::string& file);

struct PathAndTrace {
  ProbePath path;
  ForceTrace trace;  ///< model and status are not in the file: model is 0 in contact and -1 else, status kOk
};
[[nodiscard]] Result<PathAndTrace> read_trace_csv(const std::string& file,
                                                  std::uint64_t max_bytes = kMemoryLimitBytes);

/// The truth along a path: force, god object, normal, signed distance and local resolution of every sample,
/// and history_decides where that is known. Lengths that differ are an Error.
[[nodiscard]] Status write_reference_csv(const ProbePath& path, const ReferenceTrace& reference,
                                         const std::string& file);

struct PathAndReference {
  ProbePath path;
  ReferenceTrace reference;  ///< its name and exactness are not in the file
};
[[nodiscard]] Result<PathAndReference> read_reference_csv(const std::string& file,
                                                          std::uint64_t max_bytes = kMemoryLimitBytes);

/// Where the numbers of a .traj file stand. Columns are counted from 0; -1 means not there.
struct TrajColumns {
  int t = 0;
  int x = 1, y = 2, z = 3;
  int fx = -1, fy = -1, fz = -1;
  double mm_per_unit = 1.0;     ///< of positions
  double n_per_unit = 1.0;      ///< of forces
  double s_per_unit = 1.0;      ///< of times
  double sample_rate_hz = 0.0;  ///< used where t = -1
};
struct TrajRecording {
  ProbePath path;
  std::vector<Vec3> force_n;  ///< as long as the path where force columns are named, else empty
};
/// Lines of numbers between blanks, tabs, commas or semicolons; empty lines, lines starting with # or %, and
/// a first line without any number, which names the columns, are skipped.
[[nodiscard]] Result<TrajRecording> read_traj(const std::string& file, const TrajColumns& columns,
                                              std::uint64_t max_bytes = kMemoryLimitBytes);

}  // namespace palpate::trace
