// `palpate report export`: writes recordings in other programs' formats.
#pragma once

#include <string>

#include <palpate/trace.h>
#include "device/record/recording.h"
#include "experiments/session/session.h"

namespace palpate::experiments {

struct ExportArguments {
  std::string recording;
  std::string format = "csv";                  ///< csv, hdf5, motion-bids
  std::string out;                             ///< a file; a folder for motion-bids
  std::string renderer;                        ///< csv: a label; empty: the first
  std::string subject = "01", task = "touch";  ///< for motion-bids
  bool skip_damaged = false, force = false, json = false;
};
[[nodiscard]] Result<int> run_export(const ExportArguments& arguments, Context& context);

/// One renderer's frames. Skips ticks without a step or with a non-finite HIP.
[[nodiscard]] Result<trace::PathAndTrace> frames_of_recording(device::Recording& recording,
                                                              const std::string& label);

/// Writes everything as datasets of one row a tick, one group per renderer.
[[nodiscard]] Result<std::uint64_t> export_hdf5(device::Recording& recording, const std::string& file,
                                                Progress& progress);
/// True if this program was built with HDF5.
[[nodiscard]] bool has_hdf5();

/// Writes a one-subject dataset in the layout of Motion-BIDS (Brain Imaging Data Structure 1.9 and later)
/// into an empty or new folder: TSV, its JSON, channels, dataset description.
[[nodiscard]] Result<std::uint64_t> export_motion_bids(device::Recording& recording,
                                                       const std::string& folder, const std::string& subject,
                                                       const std::string& task);

}  // namespace palpate::experiments
