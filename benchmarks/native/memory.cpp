#include "memory.hpp"

#include <fstream>
#include <string>
#include <sys/resource.h>

namespace trailmark {
namespace {

// The stack and the address space set aside for the allocations of the second thread that PRM starts; hardly any of
// it is ever used.
constexpr double kSecondThread = 136.0;

// A row of /proc/self/status, in MB.
double status_row(const std::string& name) {
  std::ifstream file("/proc/self/status");
  for (std::string word; file >> word;) {
    if (word == name) {
      double kilobytes = -1.0;
      file >> kilobytes;
      return file ? kilobytes / 1024.0 : -1.0;
    }
  }
  return -1.0;
}

}  // namespace

double restart_memory_peak() {
  std::ofstream("/proc/self/clear_refs") << "5";
  return status_row("VmRSS:");
}

double memory_peak() { return status_row("VmHWM:"); }

void limit_memory(double megabytes) {
  const double mapped = status_row("VmSize:");
  if (mapped < 0.0) {
    return;
  }
  const auto bytes = static_cast<rlim_t>((mapped + megabytes + kSecondThread) * 1024.0 * 1024.0);
  const rlimit limit{bytes, bytes};
  setrlimit(RLIMIT_AS, &limit);
}

}  // namespace trailmark
