// Exports a function of a virtual board from its library.
#ifndef HOST_EXPORT_H
#define HOST_EXPORT_H

#ifdef _WIN32
#define EXPORT extern "C" __declspec(dllexport)
#else
#define EXPORT extern "C" __attribute__((visibility("default")))
#endif

#endif  // HOST_EXPORT_H
