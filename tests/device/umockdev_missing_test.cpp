// Stands where the package libumockdev-dev is not installed.
#include <cstdio>

int main() {
  std::puts(
      "skipped: built without libumockdev-dev and umockdev: drivers were not run over the real libusb and "
      "hidapi");
  constexpr int kSkipped = 77;  // what CTest takes for a skipped test
  return kSkipped;
}
