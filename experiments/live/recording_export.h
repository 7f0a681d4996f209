// The whole of `palpate export`: recordings in formats that others read.
#pragma once

#include <string>

#include "device/record/recording.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

struct ExportArguments {
  std::string recording;
  std::string format = "csv";                  ///< csv, hdf5, motion-bids
  std::string out;                             ///< a file; of motion-bids a folder
  std::string renderer;                        ///< of csv: the label of one; empty: the first
  std::string subject = "01", task = "touch";  ///< of motion-bids
  bool skip_damaged = false, force = false, json = false;
};
int run_export(const ExportArguments& arguments, Context& context);

/// One renderer's frames as Palpate writes traces: read_trace_csv() reads them. Ticks in which it was not
/// stepped, or whose HIP is not finite, are no rows. The rows that were written.
[[nodiscard]] Result<std::uint64_t> export_csv(device::Recording& recording, const std::string& label,
                                               const std::string& file);

/// Everything, in datasets of one row a tick; a group for each renderer.
[[nodiscard]] Result<std::uint64_t> export_hdf5(device::Recording& recording, const std::string& file,
                                                Progress& progress);
/// Whether this program was built with HDF5.
[[nodiscard]] bool has_hdf5();

/// A dataset of one subject as Motion-BIDS (version 1.9 of the Brain Imaging Data Structure and later) lays
/// it out, in a folder that is empty or not there: TSV, its JSON, channels, the description of the dataset.
[[nodiscard]] Result<std::uint64_t> export_motion_bids(device::Recording& recording,
                                                       const std::string& folder, const std::string& subject,
                                                       const std::string& task);

}  // namespace palpate::experiments
