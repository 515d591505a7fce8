// How the page hands over what its functions of WebAssembly read and write.

#pragma once

#include <opencv2/core.hpp>

// A plane of one channel, or a list of numbers, as opencv.js writes it.
struct Plane {
  void *data;
  int type, width, height;

  cv::Mat mat() const { return cv::Mat(height, width, type, data); }

  // The numbers as points, x and y in turn.
  cv::Mat points() const { return cv::Mat(width * height / 2, 1, CV_MAKETYPE(type, 2), data); }

  double *numbers() const { return static_cast<double *>(data); }

  int *whole() const { return static_cast<int *>(data); }
};

#define PAGE extern "C" __attribute__((used, visibility("default")))
