// What a test sets and sees of the device behind a pretended library. Lives in that library.
#pragma once

#include <atomic>

struct StubDevice {
  std::atomic<int> connected{1};
  std::atomic<bool> fails{false};  ///< every exchange from here on
  std::atomic<bool> calibrated{true};
  std::atomic<double> x_mm{0.0}, y_mm{0.0}, z_mm{0.0};
  std::atomic<unsigned> buttons{0};
  std::atomic<double> force_x_n{0.0}, force_z_n{0.0};  ///< what it holds: the last that was set
  std::atomic<int> open{0};
  std::atomic<bool> force_on{false};
};

extern "C" __attribute__((visibility("default"))) StubDevice& stub_dhd_device();
extern "C" __attribute__((visibility("default"))) StubDevice& stub_hd_device();
