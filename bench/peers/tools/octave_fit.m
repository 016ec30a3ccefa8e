% One fit with Octave's control package: octave-cli octave_fit.m METHOD DATA SAMPLE_TIME prints pole, gain and seconds.
1;
words = argv ();
pkg load control
columns = load (words{2});
sample_time = str2double (words{3});
data = iddata (columns(:, 2), columns(:, 1), sample_time);
tic;
switch (words{1})
  case "arx"
    model = arx (data, "na", 1, "nb", 2);
  case "n4sid"
    model = n4sid (data, "n", 1, "s", 20);
end
seconds = toc;
poles = pole (model);
[~, last] = max (abs (poles));
gains = dcgain (model);
printf ("%.17g %.17g %.6g\n", real (poles(last)), gains(1), seconds);
