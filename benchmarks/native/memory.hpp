// What the process takes of memory, and how much it may take. Linux only.
#pragma once

namespace trailmark {

// Sets the peak back to what is resident now and returns that (MB of 2^20 bytes); negative if the system cannot tell.
double restart_memory_peak();

// Largest resident size (MB) since the peak was set back; negative if the system cannot tell.
double memory_peak();

// Lets the process map at most `megabytes` more than it has now: beyond, allocations throw std::bad_alloc.
void limit_memory(double megabytes);

}  // namespace trailmark
