// A HID device of the running kernel, through its module uhid: hidraw, sysfs and the queue of reports are the
// kernel's own.
#pragma once

#include <memory>
#include <string>

#include "tests/device/mock/hidraw_double.h"

namespace palpate::device {

class UhidDouble {
 public:
  using Bytes = HidrawDouble::Bytes;
  using Answer = HidrawDouble::Answer;

  /// Why it cannot be made here; empty: it can.
  [[nodiscard]] static std::string missing();

  /// Plugged in, and found.
  explicit UhidDouble(const HidrawIdentity& identity, Answer answer = {});
  ~UhidDouble();
  UhidDouble(const UhidDouble&) = delete;
  UhidDouble& operator=(const UhidDouble&) = delete;

  /// A report that nobody asked for.
  void report(const Bytes& bytes);
  /// Returns when the kernel has seen it.
  void unplug();
  void plug();

 private:
  struct Node;
  std::unique_ptr<Node> node_;
};

}  // namespace palpate::device
