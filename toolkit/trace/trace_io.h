// Probe paths and force traces as text: CSV in and out, and the .traj files of Ruffaldi et al. 2006. Numbers
// are written with the fewest digits that read back to the same bits; files are written atomically. Reading
// checks everything and names file, line and remedy; memory is proportional to the file.
#pragma once

#include <string>
#include <vector>

#include "toolkit/core/result.h"
#include "toolkit/trace/trace.h"

namespace palpate::trace {

inline constexpr const char* kPathHeader = "t_s,x_mm,y_mm,z_mm";
inline constexpr const char* kTraceHeader =
    "t_s,x_mm,y_mm,z_mm,fx_n,fy_n,fz_n,contact,gx_mm,gy_mm,gz_mm,frame_ns";

/// Header exactly kPathHeader, at least one row, finite numbers, time strictly increasing.
[[nodiscard]] Result<ProbePath> read_path_csv(const std::string& file);
[[nodiscard]] Status write_path_csv(const ProbePath& path, const std::string& file);

/// One row per row of the path; frame_ns is 0 where the trace was not timed. Lengths that differ are an
/// Error.
[[nodiscard]] Status write_trace_csv(const ProbePath& path, const ForceTrace& trace, const std::string& file);

struct PathAndTrace {
  ProbePath path;
  ForceTrace trace;  ///< model and status are not in the file: model is 0 in contact and -1 else, status kOk
};
[[nodiscard]] Result<PathAndTrace> read_trace_csv(const std::string& file);

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
/// Lines of numbers between blanks, tabs, commas or semicolons; empty lines and lines starting with # or %
/// are skipped.
[[nodiscard]] Result<TrajRecording> read_traj(const std::string& file, const TrajColumns& columns);

}  // namespace palpate::trace
