// Points in memory as a stream, clouds whose points are known again after rounding, and files made of them.
#pragma once

#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "tests/files.h"
#include "tests/toolkit/messages.h"
#include "toolkit/core/random.h"
#include "toolkit/prepared/prepare.h"

namespace palpate::prepared::test {

class MemoryStream : public io::PointStream {
 public:
  explicit MemoryStream(std::vector<Vec3> points) : points_(std::move(points)) {
    header_.format = "points of a test";
    header_.points = points_.size();
  }
  const io::StreamHeader& header() const noexcept override { return header_; }
  io::StreamHeader& changed_header() noexcept { return header_; }
  Result<std::size_t> read(std::span<Vec3> out) override {
    const std::size_t n = std::min(out.size(), points_.size() - next_);
    std::copy_n(points_.begin() + static_cast<std::ptrdiff_t>(next_), n, out.begin());
    next_ += n;
    return n;
  }
  Status rewind() override {
    next_ = 0;
    return Done{};
  }

 protected:
  std::vector<Vec3> points_;

 private:
  io::StreamHeader header_;
  std::size_t next_ = 0;
};

/// A wavy sheet of `side` by `side` points, each in the middle half of its own square, in random order: a
/// point is known again by the square. A third of it is empty, and a corner is a hundred times as dense.
struct Sheet {
  std::size_t side = 0;
  double step = 1.0;
  Vec3 corner = Vec3::Zero();
  std::vector<Vec3> points;

  static Sheet make(std::size_t side, double step, const Vec3& corner, std::uint64_t seed) {
    Sheet sheet{side, step, corner, {}};
    Random random(seed);
    for (std::size_t i = 0; i < side * side; ++i) {
      const double x = static_cast<double>(i % side) + random.uniform(0.25, 0.75);
      const double y = static_cast<double>(i / side) + random.uniform(0.25, 0.75);
      const double z = 5.0 * std::sin(0.1 * x) + 3.0 * std::cos(0.07 * y) + random.uniform();
      if (i % side > side / 2 && i / side > side / 3) continue;
      sheet.points.push_back(corner + step * Vec3(x, y, z));
    }
    for (std::size_t i = sheet.points.size(); i > 1; --i)
      std::swap(sheet.points[i - 1], sheet.points[random.below(i)]);
    return sheet;
  }
  [[nodiscard]] std::size_t square(const Vec3& p) const {
    const Vec3 at = (p - corner) / step;
    return static_cast<std::size_t>(std::floor(at.y())) * side + static_cast<std::size_t>(std::floor(at.x()));
  }
};

/// Ends its process at a report, as a kill does: nothing is destroyed or flushed.
class Death final : public Progress {
 public:
  explicit Death(int at) : left_(at) {}
  void report(std::string_view, double) override {
    if (--left_ == 0) ::_exit(9);
  }

 private:
  int left_;
};

class Prepared : public InFolder {
 protected:
  [[nodiscard]] PrepareCellsReport prepare(std::vector<Vec3> points, const PrepareCellsOptions& options,
                                           const std::string& name = "cells") {
    MemoryStream stream(std::move(points));
    return palpate::test::value_of(prepare_cells(stream, options, in(name)));
  }
  [[nodiscard]] CellFile open(const std::string& name = "cells") const {
    return palpate::test::value_of(CellFile::open(in(name)));
  }
  [[nodiscard]] std::string bytes(const std::string& name = "cells") const { return file_text(in(name)); }
  void write(const std::string& name, const std::string& text) const { write_text(in(name), text); }
  [[nodiscard]] std::set<std::string> names() const {
    std::set<std::string> all;
    for (const auto& one : std::filesystem::directory_iterator(folder_))
      all.insert(one.path().filename().string());
    return all;
  }
};

}  // namespace palpate::prepared::test
